"""Scenarios and episode states of n vehicles as structures of arrays.

A Scene holds n scenarios, an EpisodeState the n episodes in them. Both are frozen. The functions of `flatgym.task` take
them and return new ones. `to` moves them to PyTorch or JAX; in JAX they are pytrees, so that `jax.jit` and `jax.vmap`
take them as arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.arrays import convert, is_jax, namespace, register_pytree
from flatgym.quadrotor import Quadrotor
from flatgym.scenarios.scenario import Scenario, Tolerance

Integers = NDArray[np.int64]

OUTCOMES = ("flying", "goal", "collision", "floor", "ceiling", "out-of-bounds", "time-limit")
"""Outcomes of an episode; all but the first end it."""
FLYING, GOAL, COLLISION, FLOOR, CEILING, OUT_OF_BOUNDS, TIME_LIMIT = range(len(OUTCOMES))

SHARED = ("quadrotor", "tolerance", "dt")
"""Fields of a Scene that all its scenarios share; the others are arrays."""


@dataclass(frozen=True)
class Scene:
    """The scenarios of n vehicles as arrays, their hoops padded to the largest number H.

    Attributes:
        quadrotor, tolerance, dt: shared by all scenarios.
        start, goal: points [m], shape (n, 2).
        hoop_centre, hoop_direction: centres [m] and unit vectors of passage, shape (n, H, 2).
        hoop_diameter: widths of the gaps [m], shape (n, H).
        hoop_count: number of hoops, shape (n,).
        floor, ceiling: heights [m], shape (n,); infinite without floor or ceiling.
        bounds: minimum x, minimum z, maximum x, maximum z [m], shape (n, 4).
        max_steps: time limit in steps, shape (n,).
        last_step: steps after which the episode is truncated, at most max_steps, shape (n,).
        thrust_factor: factor on the commanded thrust, shape (n,).
        wind: acceleration by the wind [m/s^2], shape (n, 2).
        delay: delay of the actions [steps], shape (n,); applied by the caller of `advance`, not by it.
    """

    quadrotor: Quadrotor
    tolerance: Tolerance
    dt: float
    start: Any
    goal: Any
    hoop_centre: Any
    hoop_direction: Any
    hoop_diameter: Any
    hoop_count: Any
    floor: Any
    ceiling: Any
    bounds: Any
    max_steps: Any
    last_step: Any
    thrust_factor: Any
    wind: Any
    delay: Any

    @classmethod
    def of(cls, scenarios: Sequence[Scenario]) -> Scene:
        """Return the scene of n scenarios that share vehicle, tolerance and dt; a ValueError if they do not."""
        first = scenarios[0]
        for name in ("quadrotor", "tolerance", "dt"):
            for other in scenarios:
                if getattr(other, name) != getattr(first, name):
                    raise ValueError(
                        f"scenarios of one scene must share {name}: {first.name!r} has {getattr(first, name)}, "
                        f"{other.name!r} has {getattr(other, name)}"
                    )
        n, most = len(scenarios), max(len(s.hoops) for s in scenarios)
        centre, direction, diameter = np.zeros((n, most, 2)), np.zeros((n, most, 2)), np.zeros((n, most))
        for i, s in enumerate(scenarios):
            for j, hoop in enumerate(s.hoops):
                centre[i, j], direction[i, j], diameter[i, j] = hoop.centre, hoop.direction, hoop.diameter
        return cls(
            quadrotor=first.quadrotor,
            tolerance=first.tolerance,
            dt=first.dt,
            start=np.array([s.start for s in scenarios]),
            goal=np.array([s.goal for s in scenarios]),
            hoop_centre=centre,
            hoop_direction=direction,
            hoop_diameter=diameter,
            hoop_count=np.array([len(s.hoops) for s in scenarios]),
            floor=np.array([s.heights[0] for s in scenarios]),
            ceiling=np.array([s.heights[1] for s in scenarios]),
            bounds=np.array([s.bounds for s in scenarios]),
            max_steps=np.array([s.max_steps for s in scenarios]),
            last_step=np.array([s.max_steps for s in scenarios]),
            thrust_factor=np.ones(n),
            wind=np.zeros((n, 2)),
            delay=np.zeros(n, dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self.start)

    def repeat(self, n: Any) -> Scene:
        """Return the scene with each scenario repeated n times, one number or a number for each."""
        arrays: dict[str, Any] = {name: np.repeat(value, n, axis=0) for name, value in self._arrays().items()}
        return replace(self, **arrays)

    def put(self, rows: Any, other: Scene) -> Scene:
        """Return this scene with the scenarios at `rows`, shape (m,), replaced by the m of `other`; not for JAX."""
        xp = namespace(self.start)
        arrays = {name: xp.asarray(value, copy=True) for name, value in self._arrays().items()}
        for name, value in arrays.items():
            value[rows] = getattr(other, name)
        return replace(self, **arrays)

    def to(self, xp: Any = np, dtype: Any = None, device: Any = None) -> Scene:
        """Return the scene in another library, precision or device; see `flatgym.arrays.convert`."""
        return _to(self, self._arrays(), xp, dtype, device)

    def _arrays(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name not in SHARED}


@dataclass(frozen=True)
class EpisodeState:
    """States of n episodes.

    Attributes:
        state: [x, z, vx, vz, theta], shape (n, 5).
        steps: environment steps, shape (n,).
        hoops_passed: hoops passed so far, shape (n,).
        outcome: index into OUTCOMES, shape (n,).
    """

    state: Any
    steps: Any
    hoops_passed: Any
    outcome: Any

    @property
    def terminated(self) -> Any:
        """Whether the episode has ended other than by the time limit, shape (n,)."""
        return (self.outcome != FLYING) & (self.outcome != TIME_LIMIT)

    @property
    def truncated(self) -> Any:
        """Whether the time limit ended the episode, shape (n,)."""
        return self.outcome == TIME_LIMIT

    def put(self, mask: Any, other: EpisodeState) -> EpisodeState:
        """Return these episodes with those under `mask`, shape (n,), taken from `other`."""
        values = vars(self)
        return EpisodeState(**{name: _choose(mask, getattr(other, name), value) for name, value in values.items()})

    def to(self, xp: Any = np, dtype: Any = None, device: Any = None) -> EpisodeState:
        """Return the episodes in another library, precision or device; see `flatgym.arrays.convert`."""
        return _to(self, vars(self), xp, dtype, device)


def _choose(mask: Any, new: Any, old: Any) -> Any:
    """Return rows of `new` under the mask, shape (n,), else rows of `old`."""
    return namespace(old).where(mask.reshape(-1, *(1,) * (old.ndim - 1)), new, old)


def _to(value: Any, arrays: dict[str, Any], xp: Any, dtype: Any, device: Any) -> Any:
    """Return a dataclass with its arrays in another library."""
    if is_jax(xp):
        register_pytree(Scene, SHARED)
        register_pytree(EpisodeState)
    return replace(value, **{name: convert(array, xp, dtype, device) for name, array in arrays.items()})
