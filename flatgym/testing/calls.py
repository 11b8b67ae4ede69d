"""One call of a vector environment with its results, and the protocol checks of a single call."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NoReturn, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import iterate
from numpy.typing import NDArray

from flatgym.testing.nested import difference

Envs: TypeAlias = gym.vector.VectorEnv[Any, Any, Any]
Flags = NDArray[np.bool_]

FINALS = ("final_obs", "final_info")


@dataclass(frozen=True)
class Call:
    """One reset or step, with a copy of its results.

    Attributes:
        label: name of the call in messages.
        actions: batched actions, None for a reset.
        seeds: seeds of a reset, None where not seeded.
        begins: whether this call starts an episode, other than by SAME_STEP autoreset, shape (n,).
        observations, rewards, terminated, truncated, infos: the results.
    """

    label: str
    actions: Any
    seeds: list[int | None]
    begins: Flags
    observations: Any
    rewards: Any
    terminated: Any
    truncated: Any
    infos: dict[str, Any]

    @property
    def ended(self) -> Flags:
        """Whether this call ended the episode, shape (n,)."""
        return np.asarray(self.terminated | self.truncated)

    def fail(self, text: str, env: int | None = None) -> NoReturn:
        """Raise an AssertionError that names the call and the env."""
        raise AssertionError(f"{self.label}{'' if env is None else f', env {env}'}: {text}")

    def compare(
        self, name: str, got: Any, wanted: Any, atol: float = 0.0, env: int | None = None, source: str = "expected"
    ) -> None:
        """Raise an AssertionError if two values differ by more than atol."""
        if found := difference(name, got, wanted, atol):
            place, one, other = found
            self.fail(f"{place} is {one!r}, {source} {other!r}", env)

    def rows(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the info of each env, without final ones, from arrays `key` and their masks `_key`."""
        n = len(self.begins)
        rows: list[dict[str, Any]] = [{} for _ in range(n)]
        for key, values in infos.items():
            if key.removeprefix("_") in FINALS or (key.startswith("_") and key[1:] in infos):
                continue
            mask = self.mask(infos, key)
            rows_of: Any = self.rows(values) if isinstance(values, dict) else values
            if np.shape(rows_of)[:1] != (n,):
                self.fail(f"infos[{key!r}] must have {n} rows, got {values!r}")
            for i in np.flatnonzero(mask).tolist():
                rows[i][key] = rows_of[i]
        return rows

    def mask(self, infos: dict[str, Any], key: str) -> Flags:
        """Return the mask of the envs that have an info."""
        mask, n = infos.get(f"_{key}"), len(self.begins)
        if not (isinstance(mask, np.ndarray) and mask.shape == (n,) and mask.dtype == np.bool_):
            self.fail(f"infos[{key!r}] needs a mask of {n} booleans, infos['_{key}'], got {mask!r}")
        return np.asarray(mask)


def check_observations(envs: Envs, call: Call) -> None:
    """Check that the observations are in their space."""
    if envs.observation_space.contains(call.observations):
        return
    single = envs.single_observation_space
    with suppress(KeyError, TypeError, IndexError):  # observations without rows
        for i, row in enumerate(observation_rows(envs, call)):
            kind = getattr(row, "dtype", type(row).__name__)
            if not single.contains(row):
                call.fail(f"the observation {row!r} ({kind}) is not in {single}", i)
    call.fail(f"the observations {call.observations!r} are not in {envs.observation_space}")


def check_step(call: Call, keys: dict[int, set[str]]) -> None:
    """Check rewards, flags and infos of a step; `keys` stores the info keys of each env within an episode."""
    n = len(call.begins)
    for name, kinds, what in (("rewards", "fiu", "numbers"), ("terminated", "b", "bools"), ("truncated", "b", "bools")):
        value = getattr(call, name)
        if not (isinstance(value, np.ndarray) and value.shape == (n,) and value.dtype.kind in kinds):
            call.fail(f"{name} must be a NumPy array of {n} {what}, got {value!r}")
    for i, row in enumerate(call.rows(call.infos)):
        if np.isnan(call.rewards[i]):
            call.fail("the reward is nan", i)
        if call.begins[i]:
            call.compare("the reward in the step of the reset", call.rewards[i], 0.0, env=i)
            call.compare("terminated in the step of the reset", call.terminated[i], False, env=i)
            call.compare("truncated in the step of the reset", call.truncated[i], False, env=i)
        elif not call.ended[i]:
            known = keys.setdefault(i, set(row))
            if set(row) != known:
                call.fail(f"info has the keys {sorted(row)}, at earlier steps {sorted(known)}", i)


def check_unmasked(envs: Envs, before: Call, call: Call) -> None:
    """Check that a reset with a mask does not change the other envs."""
    rows = zip(observation_rows(envs, call), observation_rows(envs, before), strict=True)
    for i, (row, earlier) in enumerate(rows):
        if not call.begins[i]:
            call.compare("the observation", row, earlier, env=i, source="its reset_mask is False, and before it was")


def check_finals(envs: Envs, call: Call) -> None:
    """Check that the masks of final_obs and final_info mark the ended envs, and that final_obs are in their space."""
    other_keys = any(key.removeprefix("_") not in FINALS for key in call.infos)
    for key in FINALS:
        if key in call.infos:
            mask = call.mask(call.infos, key)
        else:
            # An environment without infos has no final infos.
            mask = call.ended if key == "final_info" and not other_keys else np.zeros_like(call.ended)
        for i in np.flatnonzero(mask != call.ended).tolist():
            fault = "given, but the episode goes on" if mask[i] else "missing, but the episode has ended"
            call.fail(f"{key} is {fault}", i)
    for i, row in final_observations(envs, call).items():
        single = envs.single_observation_space
        if not single.contains(row):
            call.fail(f"final_obs {row!r} is not in {single}", i)


def check_unchanged(call: Call, returned: Any, later: str) -> None:
    """Check that the results of a call have not changed since."""
    for name, now in zip(("observations", "rewards", "terminated", "truncated", "infos"), returned, strict=True):
        call.compare(name, now, getattr(call, name), source=f"before {later} it was")


def final_observations(envs: Envs, call: Call) -> dict[int, Any]:
    """Return the final observations by env, from an object array or a batch."""
    if not call.ended.any():
        return {}
    final = call.infos["final_obs"]
    of_objects = isinstance(final, np.ndarray) and final.dtype == object
    rows = list(final if of_objects else iterate(envs.observation_space, final))
    return {i: rows[i] for i in np.flatnonzero(call.ended).tolist()}


def observation_rows(envs: Envs, call: Call) -> list[Any]:
    """Return the observation of each env."""
    return list(iterate(envs.observation_space, call.observations))
