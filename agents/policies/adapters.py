"""Adapters for policies of any origin: a zip, a TorchScript or ONNX file, an object of a module, a plain function.

    load_policy("my_policy.zip", trust=True)
    load_policy("my_policy.onnx")
    load_policy("my_module:policy").predict(observations)     # also "agents/mine.py:Policy"

The object may have a `predict` like Stable-Baselines3's or with fewer arguments, may be a class without constructor
arguments, a torch module, or a function of observations. It receives the observations of n vehicles, shape (n, 19). A
policy that accepts only one vehicle is called once for each, and must be stateless.
"""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.policies import archive
from agents.policies.actions import OneForMany, PolicyFailed, as_actions, shorten
from agents.policies.exported import SUFFIXES, load_exported, torch_network
from agents.policies.modules import check_place, load_object
from agents.policies.normalization import Normalized, normalized, with_statistics_beside
from agents.policies.policy import Policy
from agents.policies.spaces import Wrapped

KEYWORDS = ("state", "episode_start", "deterministic")
ZIP = ".zip"


def check_policy_name(name: str) -> None:
    """Raise a ValueError, with the way out, for a name that `load_policy` cannot take; nothing is loaded."""
    check_place(name, (ZIP, *SUFFIXES))


def load_policy(name: str, trust: bool = False, *, normalize: str = "", algorithm: str = "") -> Policy:
    """Return a policy from a file, or from "module:object" or "file.py:object", which runs that code.

    Args:
        name: path of a zip of Stable-Baselines3, of a TorchScript or an ONNX file; or the object.
        trust: as in `policies.load`, for a zip and for statistics.
        normalize: file of the VecNormalize statistics of its training. Those beside a zip are found without it; see
            `agents.policies.normalization`.
        algorithm: as in `policies.load`, for a zip.

    Raises:
        ValueError: if it is not found or cannot be imported; as `policies.load` for a zip.
        FileNotFoundError: if there is no such file.
    """
    check_policy_name(name)
    if normalize:
        archive.admit(normalize, trust)
    if algorithm and not name.endswith(ZIP):
        raise ValueError(f"an algorithm is that of a zip, and {name} is none; leave out {algorithm!r}")
    policy: Policy
    if name.endswith(ZIP):
        model = policy = archive.load(name, trust, algorithm)
        if trust and not normalize:
            return with_statistics_beside(model, Path(name), archive.describe(name, algorithm))
    elif name.endswith(SUFFIXES):
        policy = Adapted(load_exported(name, trust), name)
    else:
        policy = Adapted(load_object(name), name)
    return normalized(policy, normalize) if normalize else policy


class Adapted:
    """Adapts an object or function to Stable-Baselines3's `predict`.

    Args:
        policy: an object with `predict`, a class of such objects, a torch module, or a function.
        name: its name in error messages.

    Attributes:
        policy: the object.
        observation_space, action_space: those of the object, None if it has none.

    Raises:
        PolicyFailed: if it is none of these.
    """

    def __init__(self, policy: Any, name: str = "") -> None:
        self.name = name or type(policy).__name__
        if inspect.isclass(policy):
            policy = self._run(policy)
        self.policy = policy
        if isinstance(policy, torch.nn.Module) and not hasattr(policy, "predict"):
            policy = torch_network(policy)
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
                return self._actions(observations, arguments, len(observations))
            except OneForMany:
                raise
            except PolicyFailed as error:
                if state is not None:
                    raise
                first = error
        try:
            found = np.stack([self._actions(one, arguments, None)[0] for one in observations]), None
        except PolicyFailed:
            if self._one_by_one:
                raise
            raise first from first.__cause__
        self._one_by_one = True
        return found

    def _actions(
        self, observations: NDArray[Any], arguments: dict[str, Any], count: int | None
    ) -> tuple[NDArray[Any], Any]:
        """Return the actions for `count` observations, or for a single one without a batch axis, and the state."""
        answer = self._run(self._call, observations, **arguments)
        # A pair is (actions, state), unless it is the two numbers of one action.
        paired = isinstance(answer, tuple) and len(answer) == 2 and np.ndim(answer[0]) > 0
        actions, state = answer if paired else (answer, None)
        return as_actions(actions, count, self.name), state

    def _run(self, function: Any, *values: Any, **arguments: Any) -> Any:
        try:
            return function(*values, **arguments)
        except Exception as error:
            hint = "; observations are NumPy arrays: torch.as_tensor converts" if "must be Tensor" in str(error) else ""
            raise PolicyFailed(f"{self.name} failed: {shorten(error)}{hint}") from error


def innermost(policy: Any) -> Any:
    """Return the model or the user's object within all adapters and wrappers."""
    while isinstance(policy, (Adapted, Wrapped)):
        policy = policy.policy
    return policy


def statistics_of(policy: Any) -> Path | None:
    """Return the file of the VecNormalize statistics that a policy was loaded with, None without any."""
    while isinstance(policy, (Adapted, Wrapped)):
        if isinstance(policy, Normalized):
            return policy.source
        policy = policy.policy
    return None


def _keywords(call: Any) -> tuple[str, ...]:
    """Return the members of KEYWORDS that a function accepts."""
    try:
        taken = inspect.signature(call).parameters
    except (TypeError, ValueError):
        return ()
    anything = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in taken.values())
    return tuple(name for name in KEYWORDS if anything or name in taken)
