"""The arguments of `reset`, seeds and options: checked and applied to a fleet of any size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from flatgym.envs.config import EnvConfig, check_states
from flatgym.envs.fleet import Fleet, Mask, ResetResult, Seeds
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.reference import k_star_of, reference
from flatgym.task.scene import Integers
from flatgym.validation import numbers

OPTIONS = ("state", "hoops_passed")


def check_options(options: Any, known: tuple[str, ...] = OPTIONS) -> dict[str, Any]:
    """Return a copy of the options of `reset`.

    Raises:
        ValueError: if they are not a dict, or for unknown keys.
    """
    if options is None:
        return {}
    if not isinstance(options, dict):
        raise ValueError(f"options must be a dict or None, got {options!r}; known: {', '.join(known)}")
    unknown = set(options) - set(known)
    if unknown:
        raise ValueError(f"unknown reset options {sorted(unknown, key=str)}; known: {', '.join(known)}")
    return dict(options)


def check_num_envs(num_envs: Any) -> None:
    """Raise a ValueError for a number of environments that is not a whole number >= 1."""
    if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
        raise ValueError(f"num_envs must be at least 1, got {num_envs}")


def check_autoreset(mode: Any) -> AutoresetMode:
    """Return an autoreset mode; a ValueError lists the known ones."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(repr(one.value) for one in AutoresetMode)
        raise ValueError(f"unknown autoreset_mode {mode!r}; known: {known}") from None


def check_mask(mask: Any, n: int) -> Mask:
    """Return the option "reset_mask", shape (n,); a ValueError for anything else than n booleans."""
    values = numbers("options['reset_mask']", mask)
    if values.shape != (n,) or values.dtype != np.bool_:
        raise ValueError(f"options['reset_mask'] must be booleans of shape ({n},), got {mask!r}")
    return values


def vector_seeds(
    seed: int | Sequence[int | None] | None, n: int, begun: bool, generator: np.random.Generator
) -> Seeds | None:
    """Return a seed for each of n vehicles, or None to keep the present seeds.

    Args:
        seed: that of the first vehicle, or a list of n, in which None stands for a random one; or None.
        n: number of vehicles.
        begun: whether the vehicles have seeds.
        generator: source of random seeds.
    """
    if seed is None:
        if begun:
            return None
        seed = int(generator.integers(2**63))
    if not isinstance(seed, Sequence):
        return np.uint64(check_seed(seed)) + np.arange(n, dtype=np.uint64)
    if len(seed) != n:
        raise ValueError(f"seed must be one number or {n}, got {len(seed)}")
    drawn = generator.integers(2**63, size=n)
    return np.array([drawn[i] if one is None else check_seed(one) for i, one in enumerate(seed)], dtype=np.uint64)


def start_episodes(fleet: Fleet, mask: Mask, seeds: Seeds | None, options: dict[str, Any]) -> ResetResult:
    """Start the next episodes under `mask`, or the first episodes of `seeds`.

    Args:
        fleet: n vehicles.
        mask: the vehicles to reset, shape (n,).
        seeds: new seeds, shape (n,), or None to keep the present ones.
        options: "state", shape (5,) or (n, 5), and "hoops_passed", an integer or shape (n,).

    Raises:
        ValueError: for options of a wrong shape or range; nothing has changed then.
    """
    before = fleet.ids.copy()
    fleet.reseed(mask, seeds)
    try:
        state, passed = requested_states(options, fleet.n), requested_hoops(options, mask, fleet.hoop_counts)
    except ValueError:
        fleet.ids[:] = before
        raise
    return fleet.reset(mask, state, passed)


def known_k_star(fleet: Fleet, first: bool) -> Integers:
    """Return K* of the current episodes from their own starts, shape (n,), 0 where it is unknown.

    Args:
        fleet: n vehicles.
        first: whether the episodes are the first ones of their seeds.
    """
    config = fleet.config
    if first and config.starts is None and isinstance(config.problem, Distribution):
        return np.nan_to_num(k_star_of(config.problem, fleet.seeds), nan=0.0).astype(np.int64)
    return np.full(fleet.n, scenario_k_star(config))


def scenario_k_star(config: EnvConfig) -> int:
    """Return K* of the scenario; 0 if it is unknown, for a distribution, and with a pool of starts."""
    if config.starts is not None or isinstance(config.problem, Distribution):
        return 0
    known = reference(config.problem)
    return known.k_star if known else 0


def check_seed(seed: Any) -> int:
    """Return a seed as an int; a ValueError for anything else than an integer in 0..2^63 - 1."""
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**63:
        raise ValueError(f"a seed must be a whole number in 0..2^63 - 1, got {seed!r}")
    return int(seed)


def requested_states(options: dict[str, Any], n: int) -> Any:
    """Return the start states of the options, shape (n, 5), or None."""
    if "state" not in options:
        return None
    shape = (n,) if numbers("options['state']", options["state"]).ndim > 1 else ()
    return np.broadcast_to(check_states(options["state"], shape, "options['state']"), (n, 5))


def requested_hoops(options: dict[str, Any], mask: Mask, hoop_counts: Callable[[], Integers]) -> Any:
    """Return the hoops passed of the options, shape (n,), or None; checked for the vehicles under `mask` only."""
    if "hoops_passed" not in options:
        return None
    value, counts, n = numbers("options['hoops_passed']", options["hoops_passed"]), hoop_counts(), len(mask)
    if value.shape not in ((), (n,)) or value.dtype.kind not in "iu":
        raise ValueError(f"options['hoops_passed'] must be a whole number or one for each of {n}, got {value!r}")
    passed = np.broadcast_to(value, (n,))
    wrong = mask & ((passed < 0) | (passed > counts))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(f"options['hoops_passed'] must lie in 0..{counts[i]}, got {int(passed[i])}")
    return passed.astype(np.int64)
