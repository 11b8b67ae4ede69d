"""Compact zips: the members of Stable-Baselines3's zip, without the state of the training, byte for byte reproducible.

Equal policies give equal bytes: optimizers are stored without state, spaces without random generators, and SB3's
descriptions with memory addresses are dropped. Weights that half precision represents exactly are stored in it.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch
from gymnasium.spaces import Box, Space
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import data_to_json

from flatgym.envs.levels import Levels

TRANSIENT = (
    "_last_obs",
    "_last_episode_starts",
    "_last_original_obs",
    "_episode_num",
    "_total_timesteps",
    "_num_timesteps_at_start",
    "_current_progress_remaining",
    "action_noise",
    "ep_info_buffer",
    "ep_success_buffer",
    "lr_schedule",
    "replay_buffer_class",
    "replay_buffer_kwargs",
    "start_time",
    "tensorboard_log",
)
"""Attributes of a trained model that prediction does not need."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of all members, fixed for reproducible files."""
Model = TypeVar("Model", bound=BaseAlgorithm)


def rounded(model: Model) -> Model:
    """Round the weights of a policy to half precision in place, which halves its file; return the model."""
    model.policy.half().float()
    return model


def members(model: BaseAlgorithm) -> dict[str, bytes]:
    """Return the members of SB3's zip by name."""
    buffer = io.BytesIO()
    model.save(buffer, exclude=TRANSIENT)
    with zipfile.ZipFile(buffer) as file:
        found = {name: file.read(name) for name in file.namelist() if name != "system_info.txt"}
    spaces = {"observation_space": _fresh(model.observation_space), "action_space": _fresh(model.action_space)}
    data = json.loads(found["data"]) | json.loads(data_to_json(spaces))
    found["data"] = json.dumps(_without_descriptions(data), indent=1, sort_keys=True).encode()
    for name, state in model.get_parameters().items():
        content = io.BytesIO()
        torch.save(state | {"state": {}} if "optimizer" in name else _shortened(state), content)
        found[f"{name}.pth"] = content.getvalue()
    return found


def pack(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write members to a zip."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in contents.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), content, zipfile.ZIP_DEFLATED)


def _shortened(state: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return weights in half precision where this is exact; loading restores single precision."""
    halves = {name: value.half() for name, value in state.items()}
    return {
        name: half if torch.equal(half.to(state[name].dtype), state[name]) else state[name]
        for name, half in halves.items()
    }


def _fresh(space: Any) -> Space[Any]:
    """Return the space without its random generator."""
    if isinstance(space, Levels):
        return Levels(space.bins)
    return Box(space.low, space.high, dtype=space.dtype)


def _without_descriptions(data: dict[str, Any]) -> dict[str, Any]:
    """Return SB3's data without the readable descriptions of pickled values, which contain memory addresses."""
    return {
        name: {key: value[key] for key in (":type:", ":serialized:", "__module__") if key in value}
        if isinstance(value, dict) and ":serialized:" in value
        else value
        for name, value in data.items()
    }
