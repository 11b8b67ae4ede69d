"""Where a training stands, on disk, so that one which was killed ends as if it had not been.

A training is a row of chapters. Each begins with random numbers seeded by its number and with all
flights anew, so neither the state of generators nor that of flights needs to be kept: networks, optimizers,
replay buffer and `Progress` are all. The file holds tensors and plain values; reading it executes nothing.
"""

from __future__ import annotations

import json
import pickle
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer

from agents.evaluation.checks import VALIDATION_SEED
from agents.training.configs import Config
from agents.training.progress import Progress
from flatgym.files import write_whole

SCHEMA = 1
"""Version of the file; another is refused."""
FREE = ("max_seconds", "folder", "tensorboard")
"""Fields in which a configuration may differ from that of the checkpoint it goes on from."""
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of a replay buffer."""


def checkpoint_file(config: Config) -> Path:
    """Return the file that holds where a training stands."""
    return Path(config.folder) / "checkpoint.pt"


def chapter_seed(config: Config, chapter: int) -> int:
    """Return the seed of a chapter's random numbers and of its first flight, well below those of checks."""
    return int(np.random.default_rng([config.seed, chapter]).integers(VALIDATION_SEED // 2))


def write(config: Config, model: BaseAlgorithm, progress: Progress) -> None:
    """Write where a training stands, whole or not at all; an OSError names the file."""
    content = {
        "schema": SCHEMA,
        "config": config.to_json(),
        "progress": asdict(progress),
        "env_steps": model.num_timesteps,
        "updates": model._n_updates,
        "parameters": model.get_parameters(),
        "entropy": _entropy(model),
        "replay": _replay(model),
    }
    path = checkpoint_file(config)
    try:
        write_whole(path, lambda temporary: torch.save(content, temporary))
    except (OSError, RuntimeError) as error:  # torch has its own word for a full disk
        raise OSError(f"{path} could not be written, and the checkpoint before is intact: {error}") from error


def restore(config: Config, model: BaseAlgorithm) -> Progress:
    """Bring an untrained model to where the checkpoint in the configuration's folder stands.

    Raises:
        ValueError: for a damaged file, another version, and a configuration that differs; names the file, says the
            way out.
        FileNotFoundError: where there is none.
    """
    path = checkpoint_file(config)
    content = _read(path)
    try:
        _check_config(path, content["config"], config)
        if missing := set(model.get_parameters()) ^ set(content["parameters"]):
            raise KeyError(f"parameters {', '.join(sorted(missing))}")
        model.set_parameters(content["parameters"], exact_match=True, device="cpu")
        model.num_timesteps, model._n_updates = content["env_steps"], content["updates"]
        if (entropy := _entropy(model)) is not None:
            entropy.data.copy_(content["entropy"])
        _refill(model, content["replay"])
        return Progress(**content["progress"])
    except (KeyError, TypeError, RuntimeError, AttributeError) as error:
        raise _damaged(path, error) from error


def _read(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: there is nothing to go on from")
    try:
        with zipfile.ZipFile(path) as file:
            if (broken := file.testzip()) is not None:
                raise zipfile.BadZipFile(f"its member {broken!r} does not match its checksum")
        content = torch.load(path, map_location="cpu", weights_only=True)
    except (zipfile.BadZipFile, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise _damaged(path, error) from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise _damaged(path, f"it is not a checkpoint of schema {SCHEMA}")
    return content


def _damaged(path: Path, why: object) -> ValueError:
    return ValueError(
        f"{path} cannot be read as a checkpoint: {why}; put a copy of it there, or delete it, which begins the "
        f"training anew; the best policy so far is {path.with_name('model.zip')}"
    )


def _check_config(path: Path, text: str, config: Config) -> None:
    was, wanted = json.loads(text), json.loads(config.to_json())
    differ = [name for name in wanted if name not in FREE and was.get(name) != wanted[name]]
    if differ:
        told = ", ".join(f"{name} = {was.get(name)!r}, not {wanted[name]!r}" for name in differ)
        raise ValueError(
            f"{path} was written with {told}; ask for the same, or train in another folder, or without resume"
        )


def _entropy(model: BaseAlgorithm) -> torch.Tensor | None:
    entropy: torch.Tensor | None = getattr(model, "log_ent_coef", None)
    return entropy


def _replay(model: BaseAlgorithm) -> dict[str, Any]:
    """Return the filled part of the replay buffer, as tensors; nothing for a model without one."""
    buffer: ReplayBuffer | None = getattr(model, "replay_buffer", None)
    if buffer is None:
        return {}
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: torch.from_numpy(getattr(buffer, name)[:filled]) for name in REPLAY}
    return arrays | {"pos": buffer.pos, "full": buffer.full}


def _refill(model: BaseAlgorithm, replay: dict[str, Any]) -> None:
    buffer: ReplayBuffer | None = getattr(model, "replay_buffer", None)
    if buffer is None:
        return
    for name in REPLAY:
        getattr(buffer, name)[: len(replay[name])] = replay[name].numpy()
    buffer.pos, buffer.full = replay["pos"], replay["full"]
