"""Policies on disk: small Stable-Baselines3 zips, written atomically, loaded only if trusted.

    save(model, "hoop.zip");  load("hoop.zip", trust=True);  pretrained("hoop")

A zip is the output of `model.save` without the state of optimizers and training (`agents.policies.compact`), plus the
member `flatquad.json`, a plain-text description. `stable_baselines3.PPO.load` reads it too.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

from agents.policies.compact import members, pack
from flatgym import __version__
from flatgym.envs.spaces import action_space, observation_space
from flatgym.files import write_whole
from flatgym.task.observation import OBSERVATION_NAMES

PRETRAINED = Path(__file__).parents[1] / "pretrained"
"""Folder of the policies that come with the package."""
CARD = "flatquad.json"
"""Member of a zip that describes the policy."""
ALGORITHMS = {
    "PPO": "stable_baselines3",
    "SAC": "stable_baselines3",
    "TD3": "stable_baselines3",
    "TQC": "sb3_contrib",
}
"""Package of each algorithm whose policies can be loaded."""
POLICY_MODULES = {
    "stable_baselines3.common.policies": "PPO",
    "stable_baselines3.sac.policies": "SAC",
    "stable_baselines3.td3.policies": "TD3",
    "sb3_contrib.tqc.policies": "TQC",
}
"""Algorithm by the module of its policy class, which SB3 stores in plain text."""


def algorithm(name: str) -> type[BaseAlgorithm]:
    """Return an algorithm's class; a ValueError for an unknown name."""
    if name not in ALGORITHMS:
        raise ValueError(f"unknown algorithm {name!r}; known: {', '.join(ALGORITHMS)}")
    found: type[BaseAlgorithm] = getattr(import_module(ALGORITHMS[name]), name)
    return found


def save(model: BaseAlgorithm, path: str | Path, scenario: str = "") -> Path:
    """Write a policy atomically to a zip that `load` and SB3's own `load` read.

    Args:
        model: a PPO, SAC, TD3 or TQC.
        path: the file. Its folder is created if missing; an older file stays until the new one is complete.
        scenario: the training scenario, for the description.

    Raises:
        ValueError: for another algorithm.
        OSError: naming the file, if it cannot be written.
    """
    path = Path(path)
    algorithm(type(model).__name__)
    card = {
        "algorithm": type(model).__name__,
        "flatgym": __version__,
        "observations": list(OBSERVATION_NAMES),
        "scenario": scenario,
    }
    contents = members(model) | {CARD: json.dumps(card, indent=1).encode()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda temporary: pack(temporary, contents))
    except OSError as error:
        raise OSError(error.errno, f"the policy could not be written; an older file is intact: {error}") from error
    return path


def load(path: str | Path, trust: bool = False) -> BaseAlgorithm:
    """Return the policy in a zip.

    Loading a Stable-Baselines3 zip executes pickled code in it, with all rights of the user. Only files of the package
    are therefore loaded without `trust`.

    Args:
        path: a file written by `save` or by SB3's `model.save`.
        trust: load a file from outside the package, because its author is trusted.

    Raises:
        ValueError: for a file outside the package without `trust`, a damaged zip, an unknown algorithm, or a policy
            whose spaces differ from those of FlatQuad-v0.
        FileNotFoundError: if there is no such file.
    """
    path = Path(path)
    admit(path, trust)
    kind = algorithm(describe(path)["algorithm"])
    try:
        model = kind.load(path, device="cpu")
    except (RuntimeError, KeyError, TypeError, AttributeError, ImportError, AssertionError) as error:
        raise ValueError(f"{path} is not a policy that this version of {kind.__name__} can load: {error}") from error
    _check_spaces(path, model)
    return model


def admit(path: str | Path, trust: bool = False) -> None:
    """Raise a ValueError for a file from outside the package, unless it is trusted; see `load`."""
    if not trust and PRETRAINED.resolve() not in Path(path).resolve().parents:
        raise ValueError(
            f"{path} is not part of the package, and loading a Stable-Baselines3 file executes code in it; if you "
            "trust its author: load(path, trust=True), or --trust on the command line"
        )


def pretrained(name: str) -> BaseAlgorithm:
    """Return a policy that comes with the package; a ValueError for an unknown name, listing the known ones."""
    path = PRETRAINED / f"{name}.zip"
    known = names()
    if name not in known:
        raise ValueError(f"unknown pretrained policy {name!r}; known: {', '.join(known) or 'none'}")
    return load(path)


def names() -> tuple[str, ...]:
    """Return the names of the policies that come with the package."""
    return tuple(sorted(path.stem for path in PRETRAINED.glob("*.zip")))


def describe(path: str | Path) -> dict[str, Any]:
    """Return the description in a zip, with at least the key "algorithm", without executing anything.

    Raises:
        ValueError: for a damaged zip or an unknown algorithm; names the file.
        FileNotFoundError: if there is no such file.
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
    card.setdefault("algorithm", _algorithm_of(data))
    if card["algorithm"] not in ALGORITHMS:
        raise ValueError(f"{path} holds a policy of none of {', '.join(ALGORITHMS)}, got {card['algorithm']!r}")
    return card


def _algorithm_of(data: Mapping[str, Any]) -> str:
    """Return the algorithm of a zip that SB3 wrote, from its plain text; "" if unknown."""
    kind = data.get("policy_class")
    name = POLICY_MODULES.get(str(kind.get("__module__", "")), "") if isinstance(kind, dict) else ""
    return "" if name == "PPO" and "clip_range" not in data else name  # A2C has the same policy classes


def _check_spaces(path: Path, model: BaseAlgorithm) -> None:
    for what, has, wanted in (
        ("observations", model.observation_space, observation_space("features")),
        ("actions", model.action_space, action_space()),
    ):
        if has != wanted:
            raise ValueError(f"{path} does not fit FlatQuad-v0: its {what} are {has}, the environment's {wanted}")
