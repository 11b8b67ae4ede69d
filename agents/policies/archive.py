"""Policies on disk: Stable-Baselines3's zip, small, whole or not at all, and never loaded unasked.

    save(model, "hoop.zip");  load("hoop.zip", trust=True);  pretrained("hoop")

A zip is what `model.save` writes, without the state of optimizers and of the training, and with one more
member, `flatquad.json`, that says in plain words what it is. `stable_baselines3.PPO.load` reads it too.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import torch
from gymnasium.spaces import Box
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import data_to_json

from flatgym import __version__
from flatgym.envs.spaces import action_space, observation_space
from flatgym.files import write_whole
from flatgym.task.observation import OBSERVATION_NAMES

PRETRAINED = Path(__file__).parents[1] / "pretrained"
"""The folder of the policies that come with the package."""
CARD = "flatquad.json"
"""The member of a zip that says what it is."""
ALGORITHMS = {
    "PPO": "stable_baselines3",
    "SAC": "stable_baselines3",
    "TD3": "stable_baselines3",
    "TQC": "sb3_contrib",
}
"""The algorithms whose policies can be loaded, and where they live."""
FOREIGN = {
    "stable_baselines3.common.policies": "PPO",
    "stable_baselines3.sac.policies": "SAC",
    "stable_baselines3.td3.policies": "TD3",
    "sb3_contrib.tqc.policies": "TQC",
}
"""Module of the policy's class, which SB3 writes in plain letters, and the algorithm it belongs to."""
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
    "start_time",
    "tensorboard_log",
)
"""What a training leaves in a model and flying does not need."""
Model = TypeVar("Model", bound=BaseAlgorithm)

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The date of all members, the same as in any other file."""


def algorithm(name: str) -> type[BaseAlgorithm]:
    """Return an algorithm's class; a ValueError for an unknown name."""
    if name not in ALGORITHMS:
        raise ValueError(f"unknown algorithm {name!r}; known: {', '.join(ALGORITHMS)}")
    found: type[BaseAlgorithm] = getattr(import_module(ALGORITHMS[name]), name)
    return found


def save(model: BaseAlgorithm, path: str | Path, scenario: str = "") -> Path:
    """Write a policy to a zip that `load` and SB3's own `load` read, whole or not at all.

    Args:
        model: a PPO, SAC, TD3 or TQC.
        path: the file, in a folder that is made where it does not exist; what was there stays until all is written.
        scenario: what it was trained on, for the record.

    Raises:
        ValueError: for another algorithm.
        OSError: naming the file, where it cannot be written.
    """
    path = Path(path)
    algorithm(type(model).__name__)
    card = {
        "algorithm": type(model).__name__,
        "flatgym": __version__,
        "observations": list(OBSERVATION_NAMES),
        "scenario": scenario,
    }
    members = _members(model) | {CARD: json.dumps(card, indent=1).encode()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda temporary: _pack(temporary, members))
    except OSError as error:
        raise OSError(error.errno, f"the policy could not be written, and what was there is intact: {error}") from error
    return path


def load(path: str | Path, trust: bool = False) -> BaseAlgorithm:
    """Return the policy in a zip, to `predict` with.

    Loading a Stable-Baselines3 zip executes code that is pickled in it: whoever wrote the file can do on this machine
    whatever you can. So only files that came with the package are loaded unasked.

    Args:
        path: a file that `save` or SB3's `model.save` wrote.
        trust: load it wherever it lies, because you know who wrote it.

    Raises:
        ValueError: for a file outside the package without `trust`, one that is no whole zip of a known algorithm, and
            a policy that does not fit FlatQuad-v0.
        FileNotFoundError: where there is no such file.
    """
    path = Path(path)
    admit(path, trust)
    kind = algorithm(describe(path)["algorithm"])
    try:
        model = kind.load(path, device="cpu")
    except (RuntimeError, KeyError, TypeError, AttributeError, ImportError, AssertionError) as error:
        raise ValueError(f"{path} is not a policy which this version of {kind.__name__} can load: {error}") from error
    _check_spaces(path, model)
    return model


def admit(path: str | Path, trust: bool = False) -> None:
    """Raise a ValueError for a file that did not come with the package, unless it is trusted; see `load`."""
    if not trust and PRETRAINED.resolve() not in Path(path).resolve().parents:
        raise ValueError(
            f"{path} did not come with the package, and loading a Stable-Baselines3 file executes code in it; if you "
            "trust whoever wrote it: load(path, trust=True), or --trust on the command line"
        )


def pretrained(name: str) -> BaseAlgorithm:
    """Return a policy that came with the package; a ValueError for an unknown name, listing the known ones."""
    path = PRETRAINED / f"{name}.zip"
    known = names()
    if name not in known:
        raise ValueError(f"unknown pretrained policy {name!r}; known: {', '.join(known) or 'none'}")
    return load(path)


def names() -> tuple[str, ...]:
    """Return the names of the policies that came with the package."""
    return tuple(sorted(path.stem for path in PRETRAINED.glob("*.zip")))


def describe(path: str | Path) -> dict[str, Any]:
    """Return what a zip says of itself, above all its "algorithm"; nothing in it is executed.

    Raises:
        ValueError: for a file that is no whole zip, or not of a known algorithm; names the file.
        FileNotFoundError: where there is no such file.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as file:
            if (broken := file.testzip()) is not None:
                raise ValueError(f"{path} is damaged: its member {broken!r} does not match its checksum")
            inside = file.namelist()
            card = json.loads(file.read(CARD)) if CARD in inside else {}
            data = json.loads(file.read("data")) if "data" in inside else {}
    except (zipfile.BadZipFile, EOFError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(
            f"{path} is not a whole zip of a policy: {error}; a download may have been cut short"
        ) from error
    if not isinstance(card, dict) or not isinstance(data, dict) or not data:
        raise ValueError(f"{path} is a zip, but not of a Stable-Baselines3 policy")
    card.setdefault("algorithm", _foreign(data))
    if card["algorithm"] not in ALGORITHMS:
        raise ValueError(f"{path} holds a policy of none of {', '.join(ALGORITHMS)}, got {card['algorithm']!r}")
    return card


def _foreign(data: Mapping[str, Any]) -> str:
    """Return the algorithm of a zip that SB3 itself wrote, as far as its plain letters tell, else ""."""
    kind = data.get("policy_class")
    name = FOREIGN.get(str(kind.get("__module__", "")), "") if isinstance(kind, dict) else ""
    return "" if name == "PPO" and "clip_range" not in data else name  # A2C has the same policies


def _check_spaces(path: Path, model: BaseAlgorithm) -> None:
    for what, has, wanted in (
        ("observations", model.observation_space, observation_space("features")),
        ("actions", model.action_space, action_space()),
    ):
        if has != wanted:
            raise ValueError(f"{path} does not fit FlatQuad-v0: its {what} are {has}, the environment's {wanted}")


def _members(model: BaseAlgorithm) -> dict[str, bytes]:
    """Return the members of SB3's zip by name, optimizers as if they had never made a step."""
    buffer = io.BytesIO()
    model.save(buffer, exclude=TRANSIENT)
    with zipfile.ZipFile(buffer) as file:
        members = {name: file.read(name) for name in file.namelist() if name != "system_info.txt"}
    spaces = {"observation_space": _fresh(model.observation_space), "action_space": _fresh(model.action_space)}
    data = json.loads(members["data"]) | json.loads(data_to_json(spaces))
    members["data"] = json.dumps(_plain(data), indent=1, sort_keys=True).encode()
    for name, state in model.get_parameters().items():
        fresh = io.BytesIO()
        torch.save(state | {"state": {}} if "optimizer" in name else _short(state), fresh)
        members[f"{name}.pth"] = fresh.getvalue()
    return members


def rounded(model: Model) -> Model:
    """Round the weights of a policy to half precision, by which its file is half as long; return the model."""
    model.policy.half().float()
    return model


def _short(state: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return weights in half precision where that changes nothing; those who load them make them whole again."""
    halves = {name: value.half() for name, value in state.items()}
    return {
        name: half if torch.equal(half.to(state[name].dtype), state[name]) else state[name]
        for name, half in halves.items()
    }


def _fresh(space: Any) -> Box:
    """Return the space without its random numbers, so that the same policy gives the same file."""
    return Box(space.low, space.high, dtype=space.dtype)


def _plain(data: dict[str, Any]) -> dict[str, Any]:
    """Return SB3's data without what it writes beside pickled values to be read by people: pages, with addresses."""
    return {
        name: {key: value[key] for key in (":type:", ":serialized:", "__module__") if key in value}
        if isinstance(value, dict) and ":serialized:" in value
        else value
        for name, value in data.items()
    }


def _pack(path: Path, members: Mapping[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), content, zipfile.ZIP_DEFLATED)
