"""Training checkpoints: an interrupted run resumes and ends with identical results.

A training is a sequence of segments. Each segment seeds its random numbers by its index and resets all episodes. A
checkpoint therefore needs only networks, optimizers, replay buffer and `Progress`, not the state of generators and
episodes. The file holds tensors and plain values; reading it executes nothing.
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

from agents.evaluation.validation import VALIDATION_SEED
from agents.training.configs import Config
from agents.training.progress import Progress
from flatgym.files import write_whole

SCHEMA = 1
"""Version of the file format; other versions are refused."""
MAY_DIFFER = ("max_seconds", "env_steps", "folder", "tensorboard")
"""Fields in which a configuration may differ from that of the checkpoint."""
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of a replay buffer."""


def checkpoint_file(config: Config) -> Path:
    """Return the checkpoint file of a training."""
    return Path(config.folder) / "checkpoint.pt"


def segment_seed(config: Config, segment: int) -> int:
    """Return the seed of a segment's random numbers and first episode, below half of VALIDATION_SEED."""
    return int(np.random.default_rng([config.seed, segment]).integers(VALIDATION_SEED // 2))


def write(config: Config, model: BaseAlgorithm, progress: Progress) -> None:
    """Write a checkpoint atomically; an OSError names the file."""
    content = {
        "schema": SCHEMA,
        "config": config.to_json(),
        "progress": asdict(progress),
        "env_steps": model.num_timesteps,
        "updates": model._n_updates,
        "calls": _calls(model),
        "parameters": model.get_parameters(),
        "entropy": _entropy(model),
        "replay": _replay(model),
    }
    path = checkpoint_file(config)
    try:
        write_whole(path, lambda temporary: torch.save(content, temporary))
    except (OSError, RuntimeError) as error:  # torch raises a RuntimeError on a full disk
        raise OSError(f"{path} could not be written; the previous checkpoint is intact: {error}") from error


def restore(config: Config, model: BaseAlgorithm) -> Progress:
    """Load the checkpoint in the configuration's folder into an untrained model, and return its progress.

    Raises:
        ValueError: for a damaged file, another version, or a different configuration; names the file and the remedy.
        FileNotFoundError: if there is no checkpoint.
    """
    path = checkpoint_file(config)
    content = _read(path)
    try:
        _check_config(path, content["config"], config)
        if missing := set(model.get_parameters()) ^ set(content["parameters"]):
            raise KeyError(f"parameters {', '.join(sorted(missing))}")
        model.set_parameters(content["parameters"], exact_match=True, device="cpu")
        model.num_timesteps, model._n_updates = content["env_steps"], content["updates"]
        if (calls := content.get("calls")) is not None:
            model._n_calls = calls  # type: ignore[attr-defined]
        if (entropy := _entropy(model)) is not None:
            entropy.data.copy_(content["entropy"])
        _refill(model, content["replay"])
        return Progress(**content["progress"])
    except (KeyError, TypeError, RuntimeError, AttributeError) as error:
        raise _damaged(path, error) from error


def _read(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist; there is no training to resume")
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
        f"{path} cannot be read as a checkpoint: {why}; restore a copy of it, or delete it to start the "
        f"training over; the best policy so far is {path.with_name('model.zip')}"
    )


def _check_config(path: Path, text: str, config: Config) -> None:
    was, wanted = json.loads(text), json.loads(config.to_json())
    differ = [name for name in wanted if name not in MAY_DIFFER and was.get(name) != wanted[name]]
    if differ:
        changes = ", ".join(f"{name} = {was.get(name)!r}, not {wanted[name]!r}" for name in differ)
        raise ValueError(
            f"{path} was written with {changes}; resume with the same values, or start a new training in another "
            f"folder, from this policy if you like: policy={str(path.with_name('model.zip'))!r}"
        )


def _entropy(model: BaseAlgorithm) -> torch.Tensor | None:
    entropy: torch.Tensor | None = getattr(model, "log_ent_coef", None)
    return entropy


def _calls(model: BaseAlgorithm) -> int | None:
    """Return the number of steps by which DQN times the updates of its target network; None for others."""
    calls: int | None = getattr(model, "_n_calls", None)
    return calls


def _replay(model: BaseAlgorithm) -> dict[str, Any]:
    """Return the filled part of the replay buffer as tensors; empty for a model without one."""
    buffer: ReplayBuffer | None = getattr(model, "replay_buffer", None)
    if buffer is None:
        return {}
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: torch.from_numpy(getattr(buffer, name)[:filled]) for name in REPLAY}
    return arrays | {"pos": buffer.pos, "full": buffer.full}


def end_episodes(model: BaseAlgorithm) -> None:
    """Mark the newest steps of a replay buffer as truncated, so that no n-step return runs into another episode."""
    buffer: ReplayBuffer | None = getattr(model, "replay_buffer", None)
    if buffer is not None and (buffer.pos or buffer.full):
        buffer.timeouts[buffer.pos - 1] = np.logical_or(
            buffer.timeouts[buffer.pos - 1], 1 - buffer.dones[buffer.pos - 1]
        )


def _refill(model: BaseAlgorithm, replay: dict[str, Any]) -> None:
    buffer: ReplayBuffer | None = getattr(model, "replay_buffer", None)
    if buffer is None:
        return
    for name in REPLAY:
        getattr(buffer, name)[: len(replay[name])] = replay[name].numpy()
    buffer.pos, buffer.full = replay["pos"], replay["full"]
