"""Anybody's policy, made to fly what the scores fly: a zip, an object of a module, or a plain function.

    adapted("my_policy.zip", trust=True)
    adapted("my_module:policy").predict(observations)     # also "agents/mine.py:Policy"

What is named may have `predict`, as Stable-Baselines3 has it or with fewer arguments; may be a class that is made
without arguments; or a function of observations. It is given those of n vehicles, shape (n, 19). If it can only deal
with one, it is asked for each in turn, and had better remember nothing.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import inspect
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import policies
from agents.policies.policy import Policy

KEYWORDS = ("state", "episode_start", "deterministic")


class PolicyFailed(ValueError):
    """A policy raised an error, or returned what is no action."""


def load_policy(name: str, trust: bool = False) -> Policy:
    """Return a policy by the name of its zip, or as "module:object" or "file.py:object", whose code is run.

    Raises:
        ValueError: for what is not found or cannot be imported; as `policies.load` for a zip.
    """
    place, colon, thing = str(name).rpartition(":")
    if not colon or name.endswith(".zip"):
        if not name.endswith(".zip") and not Path(name).exists():
            raise ValueError(f"{name!r} is neither a file nor of the form module:object, as in my_module:policy")
        return policies.load(name, trust)
    return Adapted(_object(_module(place), thing), name)


class Adapted:
    """A policy with Stable-Baselines3's `predict`, around one that has less.

    Args:
        policy: an object with `predict`, a class of such, or a function.
        name: what to call it in errors.

    Raises:
        PolicyFailed: where it is none of these.
    """

    def __init__(self, policy: Any, name: str = "") -> None:
        self.name = name or type(policy).__name__
        if inspect.isclass(policy):
            policy = self._tried(policy)
        call = getattr(policy, "predict", policy)
        if not callable(call):
            raise PolicyFailed(f"{self.name} is no policy: it has no predict(observations), and is no function")
        self._call, self._taken, self._singly = call, _keywords(call), False
        self.observation_space = getattr(policy, "observation_space", None)
        self.action_space = getattr(policy, "action_space", None)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], Any]:
        """Return actions (n, 2) for observations (n, 19), and what the policy wants handed back.

        Raises:
            PolicyFailed: naming what it raised or returned.
        """
        observations, given = np.asarray(observation), (state, episode_start, deterministic)
        arguments = {key: value for key, value in zip(KEYWORDS, given, strict=True) if key in self._taken}
        if not self._singly:
            try:
                return self._asked(observations, arguments)
            except PolicyFailed as error:
                if state is not None:
                    raise
                first = error
        try:
            found = np.stack([self._asked(one, arguments, (2,))[0] for one in observations]), None
        except PolicyFailed:
            if self._singly:
                raise
            raise first from first.__cause__
        self._singly = True
        return found

    def _asked(
        self, observations: NDArray[Any], arguments: dict[str, Any], shape: tuple[int, ...] | None = None
    ) -> tuple[NDArray[Any], Any]:
        answer = self._tried(self._call, observations, **arguments)
        actions, state = answer if isinstance(answer, tuple) and len(answer) == 2 else (answer, None)
        wanted = shape or (len(observations), 2)
        try:
            actions = np.asarray(actions, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise PolicyFailed(f"{self.name} returned {answer!r}, which are no actions") from error
        if actions.shape != wanted and not (actions.size == 2 and wanted in ((1, 2), (2,))):
            raise PolicyFailed(
                f"{self.name} returned actions of shape {actions.shape} for observations of shape "
                f"{observations.shape}; wanted {wanted}"
            )
        return actions.reshape(wanted), state

    def _tried(self, function: Any, *values: Any, **arguments: Any) -> Any:
        try:
            return function(*values, **arguments)
        except Exception as error:
            raise PolicyFailed(f"{self.name} failed: {type(error).__name__}: {error}") from error


def _keywords(call: Any) -> tuple[str, ...]:
    """Return those of KEYWORDS that a function takes."""
    try:
        taken = inspect.signature(call).parameters
    except (TypeError, ValueError):
        return ()
    anything = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in taken.values())
    return tuple(name for name in KEYWORDS if anything or name in taken)


def _module(place: str) -> ModuleType:
    """Return a module by its name, also from the present folder, or by its file."""
    try:
        if place.endswith(".py"):
            found = importlib.util.spec_from_file_location(Path(place).stem, place)
            assert found is not None
            assert found.loader is not None
            module = importlib.util.module_from_spec(found)
            sys.modules[found.name] = module  # as classes of it are looked up there
            found.loader.exec_module(module)
            return module
        if (here := str(Path.cwd())) not in sys.path:
            sys.path.insert(0, here)
        return importlib.import_module(place)
    except Exception as error:  # whatever its code does while it is imported
        raise ValueError(f"{place!r} cannot be imported: {type(error).__name__}: {error}") from error


def _object(module: ModuleType, name: str) -> Any:
    """Return what a module calls so."""
    if not hasattr(module, name):
        public = [word for word in vars(module) if not word.startswith("_")]
        near = difflib.get_close_matches(name, public, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; it has {', '.join(public) or 'nothing'}"
        raise ValueError(f"module {module.__name__!r} has no {name!r}{hint}")
    return getattr(module, name)
