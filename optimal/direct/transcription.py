"""What the time-domain programs share: the exact step as symbols, the scenario as arrays, bounds of the states.

Direct multiple shooting (Bock and Plitt 1984): the unknowns are the states at nodes and the controls between them,
tied by X[k+1] = step(X[k], U[k], h). The environment flies the same closed form of `flatgym.quadrotor`. The
transcription therefore adds no integration error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array, exact_step
from flatgym.scenarios.scenario import GAP_LEAST, Hoop, Scenario
from optimal.flights.trajectory import Flight

MIN_LEG = 0.1
"""Least length that a leg counts with [m]: a phase of no length has no step length."""
CLOSE = 1e-9, 5e-4
"""Distances between two hoops that are passed at once [m]. A flight at 20 m/s flies the larger one in a phase of the
shortest steps. Hoops on one line are passed one after the other, as the environment counts them."""
PARALLEL = 1e-6
"""Sine of the angle between two hoops below which they count as parallel."""


class _Symbols:
    """The operations the exact step needs, on CasADi symbols."""

    sin = staticmethod(ca.sin)
    cos = staticmethod(ca.cos)
    where = staticmethod(ca.if_else)


@lru_cache(maxsize=1)
def step_function() -> Any:
    """Return the exact step as a CasADi function: state (5,), control (2,), h, gravity -> state (5,)."""
    state, control, h, gravity = ca.SX.sym("state", 5), ca.SX.sym("control", 2), ca.SX.sym("h"), ca.SX.sym("g")
    after = exact_step(ca.vertsplit(state), ca.vertsplit(control), h, gravity, _Symbols)
    return ca.Function("step", [state, control, h, gravity], [ca.vertcat(*after)])


@dataclass(frozen=True)
class Geometry:
    """The geometry of a scenario as read-only arrays.

    Attributes:
        points: start, hoop centres and goal [m], shape (H+2, 2).
        lengths: lengths of the legs between them, at least MIN_LEG [m], shape (H+1,).
        hoops: centre [m] and direction [x, z, direction_x, direction_z] of each hoop, shape (4, H).
        rims: both rim points [x, z, x, z] of each hoop [m], shape (4, H).
    """

    points: Array
    lengths: Array
    hoops: Array
    rims: Array


@lru_cache(maxsize=256)
def geometry(scenario: Scenario) -> Geometry:
    """Return the geometry of a scenario; computed once."""
    points = np.array([scenario.start, *((hoop.x, hoop.z) for hoop in scenario.hoops), scenario.goal])
    arrays = (
        points,
        np.maximum(np.hypot(*np.diff(points, axis=0).T), MIN_LEG),
        np.array([[*hoop.centre, *hoop.direction] for hoop in scenario.hoops]).reshape(-1, 4).T,
        np.array([hoop.rims.ravel() for hoop in scenario.hoops]).reshape(-1, 4).T,
    )
    for array in arrays:
        array.flags.writeable = False
    return Geometry(*arrays)


def distinct_hoops(scenario: Scenario, *, shared: bool = True) -> Scenario:
    """Return a scenario with one hoop in place of several that are passed at once.

    Args:
        scenario: the task.
        shared: whether that hoop is the part of the gaps that a flight straight through all of them passes. Otherwise
            it is the narrowest one, so that every flight of the task is a flight of the returned scenario too.
    """
    kept: list[tuple[Hoop, Hoop]] = []
    for hoop in scenario.hoops:
        common = _common_gap(kept[-1][0], hoop, scenario.quadrotor.radius) if kept else None
        if common is None:
            kept.append((hoop, hoop))
        else:
            kept[-1] = common, min(kept[-1][1], hoop, key=lambda one: one.diameter)
    if len(kept) == len(scenario.hoops):
        return scenario
    return replace(scenario, hoops=tuple(common if shared else narrowest for common, narrowest in kept))


def _common_gap(first: Hoop, second: Hoop, radius: float) -> Hoop | None:
    """Return the part of a hoop's gap that lies before another's close behind it; None unless a body fits through."""
    offset = second.centre - first.centre
    ahead, aside = float(offset @ first.direction), float(offset @ first.across)
    parallel = abs(float(first.across @ second.direction)) < PARALLEL and float(first.direction @ second.direction) > 0
    low = max(-first.diameter, 2 * aside - second.diameter) / 2
    high = min(first.diameter, 2 * aside + second.diameter) / 2
    if not (parallel and CLOSE[0] < ahead <= CLOSE[1] and high - low >= 2 * radius + GAP_LEAST):
        return None
    x, z = (first.centre + first.across * (low + high) / 2).tolist()
    return Hoop(x, z, high - low, first.angle)


def has_height_limits(scenario: Scenario) -> bool:
    """Return whether there is a floor or a ceiling."""
    return scenario.floor is not None or scenario.ceiling is not None


def state_limits(scenario: Scenario, nodes: int) -> tuple[Array, Array]:
    """Return lower and upper bounds of the states at the nodes, shape (5, nodes).

    The start state is fixed, heights are limited, everything else is free.
    """
    low, high = np.full((5, nodes), -np.inf), np.full((5, nodes), np.inf)
    low[1], high[1] = scenario.heights
    low[:, 0] = high[:, 0] = scenario.start_state
    return low, high


def resampled(flight: Flight, time: Array) -> tuple[Array, Array]:
    """Return a flight's states at times (n+1,) [s], shape (n+1, 5), and its mean thrusts between them, shape (n,)."""
    states, dt = flight.state(time), np.diff(time)
    return states, np.mean([flight.control(time[:-1] + share * dt)[:, 0] for share in (0.25, 0.5, 0.75)], axis=0)
