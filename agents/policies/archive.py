"""Policies on disk: small Stable-Baselines3 zips, written atomically, loaded only if trusted.

    save(model, "hoop.zip");  load("hoop.zip", trust=True);  pretrained("hoop")

A zip is the output of `model.save` without the state of optimizers and training (`agents.policies.compact`), plus the
member `flatquad.json`, a plain-text description. `stable_baselines3.PPO.load` reads it too.
"""

from __future__ import annotations

import json
import warnings
import zipfile
import zlib
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

from agents.policies.algorithms import ALGORITHMS, algorithm, recognise
from agents.policies.compact import members, pack
from agents.policies.modules import add_places
from agents.policies.spaces import check_actions, layout
from flatgym import __version__
from flatgym.files import write_whole
from flatgym.task.observation import observation_names
from flatgym.validation import choice

PRETRAINED = Path(__file__).parents[1] / "pretrained"
"""Folder of the policies that come with the package."""
CARD = "flatquad.json"
"""Member of a zip that describes the policy."""
WEIGHTS = "policy.pth"
"""Member of a zip that holds the weights of the policy."""


def save(model: BaseAlgorithm, path: str | Path, scenario: str = "") -> Path:
    """Write a policy atomically to a zip that `load` and SB3's own `load` read.

    Args:
        model: of any algorithm of `agents.policies.algorithms`.
        path: the file. Its folder is created if missing; an older file stays until the new one is complete.
        scenario: the training scenario, for the description.

    Raises:
        ValueError: for another algorithm, and for observations that FlatQuad-v0 does not have.
        OSError: naming the file, if it cannot be written.
    """
    path = Path(path)
    algorithm(type(model).__name__)
    card: dict[str, Any] = {
        "algorithm": type(model).__name__,
        "flatgym": __version__,
        "observations": list(observation_names(layout(model.observation_space).observation)),
        "scenario": scenario,
    }
    if (statistics := model.get_vec_normalize_env()) is not None:
        card["normalized"] = statistics.norm_obs  # its statistics are a file of their own
    contents = members(model) | {CARD: json.dumps(card, indent=1).encode()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda temporary: pack(temporary, contents))
    except OSError as error:
        raise OSError(error.errno, f"the policy could not be written; an older file is intact: {error}") from error
    return path


def load(path: str | Path, trust: bool = False, algorithm_name: str = "") -> BaseAlgorithm:
    """Return the policy in a zip.

    Loading a Stable-Baselines3 zip executes pickled code in it, with all rights of the user. Only files of the package
    are therefore loaded without `trust`.

    Args:
        path: a file written by `save` or by SB3's `model.save`.
        trust: load a file from outside the package, because its author is trusted.
        algorithm_name: the algorithm, if the zip does not show it; by default what `describe` finds.

    Raises:
        ValueError: for a file outside the package without `trust`, a damaged zip, an unknown algorithm, or a policy
            whose spaces FlatQuad-v0 does not have, stacked or not.
        FileNotFoundError: if there is no such file.
    """
    path = Path(path)
    admit(path, trust)
    card = describe(path, algorithm_name)
    kind = algorithm(card["algorithm"])
    add_places(Path.cwd(), path.resolve().parent)  # for the module of a policy class of one's own
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "Could not deserialize object policy_class", UserWarning)
            warnings.filterwarnings("ignore", "`n_steps=", UserWarning)  # of n-step returns, in training only
            model = kind.load(path, device="cpu")
    except (RuntimeError, KeyError, TypeError, AttributeError, ImportError, AssertionError, UserWarning) as error:
        reason = str(error).rpartition("Exception: ")[2]  # of SB3's warning, which says more
        written = card.get("flatgym", __version__)
        hint = (
            "" if written == __version__ else f"; flatgym {written} wrote it, and this is {__version__}: install that"
        )
        raise ValueError(
            f"{path} is not a policy that this version of {kind.__name__} can load: {reason}{hint}"
        ) from error
    try:
        layout(model.observation_space, exact=True)
        check_actions(model.action_space, exact=True)
    except ValueError as error:
        raise ValueError(f"{path} does not fit FlatQuad-v0: {error}") from None
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
    return load(PRETRAINED / f"{choice('pretrained policy', name, names())}.zip")


def names() -> tuple[str, ...]:
    """Return the names of the policies that come with the package."""
    return tuple(sorted(path.stem for path in PRETRAINED.glob("*.zip")))


def describe(path: str | Path, algorithm_name: str = "") -> dict[str, Any]:
    """Return the description in a zip, with at least the key "algorithm", without executing anything.

    Args:
        path: the zip.
        algorithm_name: the algorithm, if the zip does not show it.

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
            weights = file.read(WEIGHTS) if WEIGHTS in inside else b""
    except (zipfile.BadZipFile, zlib.error, EOFError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(
            f"{path} is not a whole zip of a policy: {error}; a download may have been cut short"
        ) from error
    if not isinstance(card, dict) or not isinstance(data, dict) or not data:
        raise ValueError(f"{path} is a zip, but not of a Stable-Baselines3 policy")
    card.setdefault("algorithm", recognise(data, weights))
    if algorithm_name:
        card["algorithm"] = algorithm(algorithm_name).__name__
    if card["algorithm"] not in ALGORITHMS:
        raise ValueError(
            f"{path} holds a policy of none of {', '.join(ALGORITHMS)}, got {card['algorithm']!r}; if it is of one of "
            "them, name it: load(path, trust=True, algorithm_name=...), or --algorithm on the command line"
        )
    return card
