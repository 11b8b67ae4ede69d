"""Adapters for policies of other libraries: a zip, an object of a module, or a plain function.

    load_policy("my_policy.zip", trust=True)
    load_policy("my_module:policy").predict(observations)     # also "agents/mine.py:Policy"

The object may have a `predict` like Stable-Baselines3's or with fewer arguments, may be a class without constructor
arguments, or a function of observations. It receives the observations of n vehicles, shape (n, 19). A policy that
accepts only one vehicle is called once for each, and must be stateless.
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
    """A policy raised an error, or returned invalid actions."""


def load_policy(name: str, trust: bool = False) -> Policy:
    """Return a policy from a zip, or from "module:object" or "file.py:object", which runs that code.

    Args:
        name: path of the zip, or the object.
        trust: as in `policies.load`, for a zip.

    Raises:
        ValueError: if it is not found or cannot be imported; as `policies.load` for a zip.
    """
    place, colon, thing = str(name).rpartition(":")
    if not colon or name.endswith(".zip"):
        if not name.endswith(".zip") and not Path(name).exists():
            raise ValueError(f"{name!r} is neither a file nor of the form module:object, as in my_module:policy")
        return policies.load(name, trust)
    return Adapted(_object(_module(place), thing), name)


class Adapted:
    """Adapts an object or function to Stable-Baselines3's `predict`.

    Args:
        policy: an object with `predict`, a class of such objects, or a function.
        name: its name in error messages.

    Raises:
        PolicyFailed: if it is none of these.
    """

    def __init__(self, policy: Any, name: str = "") -> None:
        self.name = name or type(policy).__name__
        if inspect.isclass(policy):
            policy = self._run(policy)
        call = getattr(policy, "predict", policy)
        if not callable(call):
            raise PolicyFailed(f"{self.name} is not a policy: it has no predict(observations) and is not a function")
        self._call, self._keywords_taken, self._one_by_one = call, _keywords(call), False
        self.observation_space = getattr(policy, "observation_space", None)
        self.action_space = getattr(policy, "action_space", None)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], Any]:
        """Return actions (n, 2) for observations (n, 19), and the state for the next call.

        Raises:
            PolicyFailed: naming the error or the invalid actions.
        """
        observations, given = np.asarray(observation), (state, episode_start, deterministic)
        arguments = {key: value for key, value in zip(KEYWORDS, given, strict=True) if key in self._keywords_taken}
        if not self._one_by_one:
            try:
                return self._actions(observations, arguments)
            except PolicyFailed as error:
                if state is not None:
                    raise
                first = error
        try:
            found = np.stack([self._actions(one, arguments, (2,))[0] for one in observations]), None
        except PolicyFailed:
            if self._one_by_one:
                raise
            raise first from first.__cause__
        self._one_by_one = True
        return found

    def _actions(
        self, observations: NDArray[Any], arguments: dict[str, Any], shape: tuple[int, ...] | None = None
    ) -> tuple[NDArray[Any], Any]:
        answer = self._run(self._call, observations, **arguments)
        actions, state = answer if isinstance(answer, tuple) and len(answer) == 2 else (answer, None)
        wanted = shape or (len(observations), 2)
        try:
            actions = np.asarray(actions, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise PolicyFailed(f"{self.name} returned {answer!r}, which is not an array of actions") from error
        if actions.shape != wanted and not (actions.size == 2 and wanted in ((1, 2), (2,))):
            raise PolicyFailed(
                f"{self.name} returned actions of shape {actions.shape} for observations of shape "
                f"{observations.shape}; wanted {wanted}"
            )
        return actions.reshape(wanted), state

    def _run(self, function: Any, *values: Any, **arguments: Any) -> Any:
        try:
            return function(*values, **arguments)
        except Exception as error:
            raise PolicyFailed(f"{self.name} failed: {type(error).__name__}: {error}") from error


def _keywords(call: Any) -> tuple[str, ...]:
    """Return the members of KEYWORDS that a function accepts."""
    try:
        taken = inspect.signature(call).parameters
    except (TypeError, ValueError):
        return ()
    anything = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in taken.values())
    return tuple(name for name in KEYWORDS if anything or name in taken)


def _module(place: str) -> ModuleType:
    """Return a module by its name, the current folder included, or by its file."""
    try:
        if place.endswith(".py"):
            found = importlib.util.spec_from_file_location(Path(place).stem, place)
            assert found is not None
            assert found.loader is not None
            module = importlib.util.module_from_spec(found)
            sys.modules[found.name] = module  # pickle and dataclasses look classes up there
            found.loader.exec_module(module)
            return module
        if (here := str(Path.cwd())) not in sys.path:
            sys.path.insert(0, here)
        return importlib.import_module(place)
    except Exception as error:  # importing runs arbitrary code
        raise ValueError(f"{place!r} cannot be imported: {type(error).__name__}: {error}") from error


def _object(module: ModuleType, name: str) -> Any:
    """Return an object of a module by its name."""
    if not hasattr(module, name):
        public = [word for word in vars(module) if not word.startswith("_")]
        near = difflib.get_close_matches(name, public, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; it has {', '.join(public) or 'nothing'}"
        raise ValueError(f"module {module.__name__!r} has no {name!r}{hint}")
    return getattr(module, name)
