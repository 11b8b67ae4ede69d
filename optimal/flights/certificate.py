"""What can be shown of a flight without its solver: limits, replay, hoops, heights, a bound.

Nothing here is shared with the transcriptions. The flight is asked for its state and control at
any time; its controls, averaged over short intervals, are flown again through `Quadrotor.step`
from the start, and the arcs so flown - not the solver's nodes - are held against hoops, floor and
ceiling. The replay is itself a flight of held controls, known in closed form, so that all that is
said of its controls and its path is a bound at every instant (`flatgym.arc`), not a sample.

What the flight itself does between two instants is shown in one of three ways. Held controls are
their own bounds. A `BoundsControls` flight (singular arcs: `optimal.indirect.pontryagin`) proves bounds of its controls; the
paths of both are their replays'. A `BoundsPath` flight, which may be further from its replay
than from a limit it touches, proves bounds of its own controls and path (flat motions:
`optimal.flat.bounds`), and the replay only that they belong together. Of any other flight nothing is
known, and its controls are unbounded. What could not be shown is inf, never 0.
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
    AGREEMENT,
    TURN,
    drift,
    fine_grid,
    hoop_crossings,
    path_violation,
    replay_controls,
    rest_error,
)
from optimal.flights.trajectory import Flight, Trajectory

TOLERANCE = 1e-9
"""Largest violation of a limit by a certified flight, relative for controls, else [m]: rounding's share."""
MEETS, NEWTON_STEPS = 1e-12, 8
"""How close to the line of a hoop a flight has met it [m], and the steps taken to find that instant."""
FINER, FINEST = 16, 2**16
"""By how many times the arcs are made more at most at once, and the most arcs of an interval: one is exact for a
control held over the interval, and the error falls with the square of their number for smooth ones."""


@runtime_checkable
class BoundsControls(Protocol):
    """A flight that proves bounds of its controls in continuous time."""

    def control_range(self) -> Array:
        """Return bounds of [thrust, rate], least and greatest, shape (2, 2); infinite where nothing is shown."""


@runtime_checkable
class BoundsPath(BoundsControls, Protocol):
    """A flight that proves bounds of its controls and of its path in continuous time."""

    def support_bound(self, direction: Array) -> float:
        """Return an upper bound of position . direction [m]; inf where nothing is shown."""

    def distance_bound(self, point: Array) -> float:
        """Return a lower bound of the distance to a point [m]; 0 where nothing is shown."""


@dataclass(frozen=True)
class Certificate:
    """What was shown of a flight.

    Attributes:
        max_control_violation: largest excess of thrust or rate over its limits, relative to the
            upper limit, in continuous time, of the flight and of its replay.
        max_path_violation: largest depth below the floor, above the ceiling, or of the body in the rim of
            a hoop, in continuous time [m], of the flight where it is `BoundsPath`, else of its replay.
        replay_error: largest difference between the flight's states and its controls flown again
            through `Quadrotor.step` [m, m/s, rad].
        terminal_error: largest difference of the replay's last state from rest at the goal, theta
            modulo 2 pi, and of the flight's first state from rest at the start [m, m/s, rad].
        hoop_clearance: least distance to the ends of a gap when crossing it [m]; negative outside the
            gap, -inf where a hoop is never crossed, inf where there is no hoop.
        hamiltonian_drift: spread of the Hamiltonian along the flight, relative to its mean, from the solver's
            costates; inf where it has none.
        lower_bound: a time no flight can beat [s].
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
        """Return whether the flight keeps every limit to TOLERANCE, and is what it says to AGREEMENT.

        One that is faster than any flight can be is none.
        """
        return (
            self.max_control_violation <= TOLERANCE
            and self.max_path_violation <= TOLERANCE
            and self.replay_error <= AGREEMENT
            and self.terminal_error <= AGREEMENT
            and self.hoop_clearance >= -TOLERANCE
            and self.gap >= 0
        )

    def row(self) -> dict[str, float]:
        """Return the fields by name."""
        return asdict(self)


def certify(flight: Flight | None, scenario: Scenario) -> Certificate:
    """Examine a flight against a scenario; None, or a flight with a NaN, shows nothing.

    Args:
        flight: anything that answers as a `Flight` does.
        scenario: the task it claims to solve, between exact rest and exact rest.
    """
    bound = projection_bound(scenario)
    if flight is None:
        return Certificate(lower_bound=bound)
    turns = np.abs(np.diff(flight.state(flight.breakpoints)[:, 4]))
    parts = np.maximum(np.ceil(np.nan_to_num(turns, posinf=0.0) / TURN), 1).astype(np.intp)
    largest = math.inf
    while True:
        time = fine_grid(flight.breakpoints, parts)
        states = flight.state(time)
        replay, arcs = replay_controls(flight, scenario.quadrotor, scenario.start_state, time, states)
        if not (np.isfinite(states).all() and np.isfinite(replay).all()):
            return Certificate(lower_bound=bound)
        ends = np.append(0, np.cumsum(parts))
        added = drift(replay[ends] - states[ends], time[ends])
        # An error that does not fall is none of the arcs': the flight does not do what its controls say.
        if np.abs(replay - states).max() <= AGREEMENT / 2 or added.max() > largest / 2 or parts.max() >= FINEST:
            break
        largest = added.max()
        aim = min(AGREEMENT / 4 / math.sqrt(len(parts)), largest / FINER)
        parts = np.ceil(parts * np.clip(np.sqrt(added / aim), 1, FINER)).astype(np.intp)
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
    """Return the largest relative excess over the scenario's limits, of the controls told and of those flown again."""
    low, high = scenario.quadrotor.control_low, scenario.quadrotor.control_high
    least, greatest = control_range(flight)
    least, greatest = np.minimum(least, arcs.control.min(axis=0)), np.maximum(greatest, arcs.control.max(axis=0))
    excess = np.nan_to_num(np.maximum(low - least, greatest - high) / high, nan=math.inf, posinf=math.inf)
    return float(max(0.0, excess.max()))


def control_range(flight: Flight) -> Array:
    """Return proven bounds of a flight's [thrust, rate], least and greatest, shape (2, 2); infinite if there are none.

    Only a flight whose class is known, or that proves them itself, has any: what answers like a
    `Trajectory` may still do something else between two breakpoints.
    """
    if isinstance(flight, BoundsControls):
        return flight.control_range()
    if type(flight) is Trajectory:
        return np.array([flight.controls.min(axis=0), flight.controls.max(axis=0)])
    return np.array([[-math.inf] * 2, [math.inf] * 2])


def claimed_path_violation(flight: BoundsPath, scenario: Scenario) -> float:
    """Return what `path_violation` does, of the path that a flight tells [m]."""
    depth, up, radius = 0.0, np.array([0.0, 1.0]), scenario.quadrotor.radius
    if scenario.floor is not None:
        depth = max(depth, scenario.floor + flight.support_bound(-up))
    if scenario.ceiling is not None:
        depth = max(depth, flight.support_bound(up) - scenario.ceiling)
    rims = [rim for hoop in scenario.hoops for rim in hoop.rims] if radius > 0 else []
    return max([depth, *(radius - flight.distance_bound(rim) for rim in rims)])


def hoop_clearance(flight: Flight, arcs: Arc, scenario: Scenario) -> float:
    """Return the least clearance of all hoops [m]; -inf where one is never crossed, inf where there is none.

    A `BoundsPath` flight is looked at itself, at the instant close to the replay's crossing when it meets the
    line; other flights are their replay.
    """
    crossings = hoop_crossings(arcs, scenario)
    if len(crossings) < len(scenario.hoops):
        return -math.inf
    if isinstance(flight, BoundsPath):
        told = zip(scenario.hoops, crossings, strict=True)
        return min((claimed_clearance(flight, scenario, hoop, time) for hoop, (time, _) in told), default=math.inf)
    return min((clearance for _, clearance in crossings), default=math.inf)


def claimed_clearance(flight: Flight, scenario: Scenario, hoop: Hoop, time: float) -> float:
    """Return the clearance with which a flight passes a hoop's line close to a time [m]; -inf where it does not."""
    for _ in range(NEWTON_STEPS):
        offset, velocity = flight(time) - hoop.centre, flight(time, 1)
        along, speed = float(offset @ hoop.direction), float(velocity @ hoop.direction)
        if speed <= 0 or not abs(along) <= AGREEMENT:
            return -math.inf
        if abs(along) <= MEETS:
            return hoop.half_gap(scenario.quadrotor.radius) - abs(float(offset @ hoop.across))
        time = min(max(time - along / speed, 0.0), flight.duration)
    return -math.inf
