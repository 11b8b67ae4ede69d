"""The certificate of a flight, independent of its solver: limits, replay, hoops, heights, a lower bound.

The certificate shares nothing with the transcriptions. It evaluates the flight's state and control at any time. It
averages the controls over short intervals and replays them through `Quadrotor.step` from the start. The arcs of this
replay, not the solver's nodes, are compared with hoops, floor and ceiling. The replay has held controls and a closed
form. Its controls and its path are therefore bounded at every instant (`flatgym.arc`), not sampled.

The flight itself between two instants is bounded in one of three ways:

- held controls are their own bounds, and the path is that of the replay;
- a `BoundsControls` flight (singular arcs: `optimal.indirect.extremal`) proves bounds of its controls, and the path is
  that of the replay;
- a `BoundsPath` flight (flat motions: `optimal.flat.bounds`) proves bounds of its controls and its path. It may be
  further from its replay than from a limit that it touches. The replay only shows that controls and path agree.

Nothing is known of any other flight, and its controls count as unbounded. A quantity that cannot be shown is inf, never
0.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from flatgym.arc import Arc
from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.flights.projection_bound import projection_bound
from optimal.flights.replay import (
    REPLAY_TOLERANCE,
    converged_replay,
    hoop_crossings,
    path_violation,
    rest_error,
)
from optimal.flights.trajectory import Flight, Trajectory

TOLERANCE = 1e-9
"""Largest violation of a limit by a certified flight, for rounding: relative for controls, else [m]."""
CROSSING_TOLERANCE, NEWTON_STEPS = 1e-12, 8
"""Distance to the line of a hoop that counts as on it [m], and most Newton steps to find that instant."""


@runtime_checkable
class BoundsControls(Protocol):
    """A flight that proves bounds of its controls in continuous time."""

    def control_range(self) -> Array:
        """Return lower and upper bounds of [thrust, rate], shape (2, 2); infinite if nothing is proven."""


@runtime_checkable
class BoundsPath(BoundsControls, Protocol):
    """A flight that proves bounds of its controls and of its path in continuous time."""

    def support_bound(self, direction: Array) -> float:
        """Return an upper bound of position . direction [m]; inf if nothing is proven."""

    def distance_bound(self, point: Array) -> float:
        """Return a lower bound of the distance to a point [m]; 0 if nothing is proven."""


@dataclass(frozen=True)
class Certificate:
    """Verified properties of a flight.

    Attributes:
        max_control_violation: largest violation of the limits of thrust or rate, relative to the upper limit, in
            continuous time, by the flight and by its replay.
        max_path_violation: largest depth below the floor, above the ceiling, or of the body in the rim of a hoop, in
            continuous time [m], of a `BoundsPath` flight itself, else of its replay.
        replay_error: largest difference between the flight's states and the replay of its controls through
            `Quadrotor.step` [m, m/s, rad].
        terminal_error: largest difference of the replay's last state from rest at the goal, theta modulo 2 pi, and of
            the flight's first state from rest at the start [m, m/s, rad].
        hoop_clearance: least distance to the ends of a gap at its crossing [m]; negative outside the gap, -inf if a
            hoop is never crossed, inf without hoops.
        hamiltonian_drift: range of the Hamiltonian along the flight, relative to its mean, from the solver's
            costates; inf without costates.
        lower_bound: a time that no flight can beat [s].
        gap: time / lower_bound - 1.
    """

    max_control_violation: float = math.inf
    max_path_violation: float = math.inf
    replay_error: float = math.inf
    terminal_error: float = math.inf
    hoop_clearance: float = -math.inf
    hamiltonian_drift: float = math.inf
    lower_bound: float = 0.0
    gap: float = math.inf

    def holds(self) -> bool:
        """Return whether the flight keeps every limit to TOLERANCE, and its replay and ends agree to REPLAY_TOLERANCE.

        A flight that is faster than its lower bound fails.
        """
        return not self.shortfall()

    def shortfall(self) -> str:
        """Return what does not hold, with values and limits; empty if everything holds."""
        limits = {
            "max_control_violation": TOLERANCE,
            "max_path_violation": TOLERANCE,
            "replay_error": REPLAY_TOLERANCE,
            "terminal_error": REPLAY_TOLERANCE,
        }
        failed = [
            f"{name} = {getattr(self, name):.3g}, at most {most:g}"
            for name, most in limits.items()
            if not getattr(self, name) <= most
        ]
        if not self.hoop_clearance >= -TOLERANCE:
            failed.append(f"hoop_clearance = {self.hoop_clearance:.3g}, at least {-TOLERANCE:g}")
        if not self.gap >= 0:
            failed.append(f"gap = {self.gap:.3g}, at least 0")
        return f"The certificate does not hold: {'; '.join(failed)} (inf: nothing is proven)." if failed else ""

    def row(self) -> dict[str, float]:
        """Return the fields by name."""
        return asdict(self)


def certify(flight: Flight | None, scenario: Scenario) -> Certificate:
    """Return the certificate of a flight; for None, or a flight with a NaN, it holds nothing but the lower bound.

    Args:
        flight: any object with the methods of `Flight`.
        scenario: the task that it should solve, from exact rest to exact rest.
    """
    bound = projection_bound(scenario)
    if flight is None:
        return Certificate(lower_bound=bound)
    states, replay, arcs = converged_replay(flight, scenario)
    if not (np.isfinite(states).all() and np.isfinite(replay).all()):
        return Certificate(lower_bound=bound)
    return Certificate(
        max_control_violation=control_violation(flight, arcs, scenario),
        max_path_violation=(
            claimed_path_violation(flight, scenario)
            if isinstance(flight, BoundsPath)
            else path_violation(arcs, scenario)
        ),
        replay_error=float(np.abs(replay - states).max()),
        terminal_error=max(
            rest_error(replay[-1], scenario.goal_state), float(np.abs(states[0] - scenario.start_state).max())
        ),
        hoop_clearance=hoop_clearance(flight, arcs, scenario),
        lower_bound=bound,
        gap=flight.duration / bound - 1 if bound > 0 else math.inf,
    )


def control_violation(flight: Flight, arcs: Arc, scenario: Scenario) -> float:
    """Return the largest relative violation of the control limits, by the flight and by its replay."""
    low, high = scenario.quadrotor.control_low, scenario.quadrotor.control_high
    least, greatest = control_range(flight)
    least, greatest = np.minimum(least, arcs.control.min(axis=0)), np.maximum(greatest, arcs.control.max(axis=0))
    violation = np.nan_to_num(np.maximum(low - least, greatest - high) / high, nan=math.inf, posinf=math.inf)
    return float(max(0.0, violation.max()))


def control_range(flight: Flight) -> Array:
    """Return proven lower and upper bounds of a flight's [thrust, rate], shape (2, 2); infinite if there are none.

    Only a `Trajectory` and a flight that proves its bounds have any. An object that merely has the methods of
    `Trajectory` may differ from it between two breakpoints.
    """
    if isinstance(flight, BoundsControls):
        return flight.control_range()
    if type(flight) is Trajectory:
        return np.array([flight.controls.min(axis=0), flight.controls.max(axis=0)])
    return np.array([[-math.inf] * 2, [math.inf] * 2])


def claimed_path_violation(flight: BoundsPath, scenario: Scenario) -> float:
    """Return the same as `path_violation`, from the bounds that the flight proves of its path [m]."""
    depth, up, radius = 0.0, np.array([0.0, 1.0]), scenario.quadrotor.radius
    if scenario.floor is not None:
        depth = max(depth, scenario.floor + flight.support_bound(-up))
    if scenario.ceiling is not None:
        depth = max(depth, flight.support_bound(up) - scenario.ceiling)
    rims = [rim for hoop in scenario.hoops for rim in hoop.rims] if radius > 0 else []
    return max([depth, *(radius - flight.distance_bound(rim) for rim in rims)])


def hoop_clearance(flight: Flight, arcs: Arc, scenario: Scenario) -> float:
    """Return the least clearance of all hoops [m]; -inf if one is never crossed, inf without hoops.

    For a `BoundsPath` flight the clearance is that of the flight itself, where it crosses the line close to the
    crossing of the replay. For other flights it is that of the replay.
    """
    crossings = hoop_crossings(arcs, scenario)
    if len(crossings) < len(scenario.hoops):
        return -math.inf
    if isinstance(flight, BoundsPath):
        pairs = zip(scenario.hoops, crossings, strict=True)
        return min((claimed_clearance(flight, scenario, hoop, time) for hoop, (time, _) in pairs), default=math.inf)
    return min((clearance for _, clearance in crossings), default=math.inf)


def claimed_clearance(flight: Flight, scenario: Scenario, hoop: Hoop, time: float) -> float:
    """Return the clearance of a flight where it crosses a hoop's line close to a time [m]; -inf if it does not."""
    for _ in range(NEWTON_STEPS):
        offset, velocity = flight(time) - hoop.centre, flight(time, 1)
        along, speed = float(offset @ hoop.direction), float(velocity @ hoop.direction)
        if speed <= 0 or not abs(along) <= REPLAY_TOLERANCE:
            return -math.inf
        if abs(along) <= CROSSING_TOLERANCE:
            return hoop.half_gap(scenario.quadrotor.radius) - abs(float(offset @ hoop.across))
        time = min(max(time - along / speed, 0.0), flight.duration)
    return -math.inf
