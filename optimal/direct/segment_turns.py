"""Local search over whole turns of the tilt on single segments, for tracks of several hoops.

A segment is the part of a flight between two stations: start, hoops, goal. A track of m hoops has 3^(m+1) ways to make
at most one whole turn on each segment, and a local optimum for most of them. They cannot be enumerated, but good ones
differ from one another by few turns. A flight has 2 (m+1) neighbours, with one whole turn more or less on one segment.
The search keeps all local optima that it finds, and solves for the neighbours of the BREADTH fastest until no flight is
left among these whose neighbours are not known.

Turns far from one another do not interact, because the hoops between them hold the flight. A turn that makes a flight
no faster is therefore not tried on a flight that differs by one turn beyond REACH segments.

A turn may make the neighbouring segments slower before a further turn makes them faster. A search with breadth 1
therefore ends 0.6 % above the best flight on a slalom of 6 hoops, with breadth 2 it does not.

The last start tests the fastest flight: it takes from it only the passing times and the tilts at the stations.
"""

from __future__ import annotations

import operator
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from flatgym.scenarios.scenario import Scenario
from optimal.direct.guesses import turned_guess
from optimal.direct.program import NODES, Shape, coarse_steps
from optimal.direct.shooting import ShootingSolution, solve_coarse_along, solve_from
from optimal.direct.transcription import has_height_limits

BREADTH = 2
"""Fastest flights whose neighbours are all solved for."""
REACH = 2
"""Most segments between two turns that interact. On 15 tracks of 4 to 12 hoops the fastest flight is the same as
without this limit, found in three quarters of the solves."""
SAME_TIME = 1e-4
"""Relative difference of two flight times on the coarse grid below which they count as one local optimum."""
Turn = tuple[int, int]
"""A segment and whole turns added there."""


@dataclass(frozen=True, eq=False)
class _Optimum:
    """A flight and its neighbours.

    Attributes:
        shot: the flight.
        left: turns to neighbours that are not solved for yet.
        tried: turns to neighbours that are solved for or left out.
        vain: turns that made it no faster.
        related: flights that differ by one turn, and its segment.
    """

    shot: ShootingSolution
    left: deque[Turn]
    tried: list[Turn] = field(default_factory=list)
    vain: set[Turn] = field(default_factory=set)
    related: list[tuple[_Optimum, int]] = field(default_factory=list)

    @property
    def duration(self) -> float:
        return self.shot.trajectory.duration

    def is_vain(self, turn: Turn, asking: _Optimum | None = None) -> bool:
        """Return whether a turn made this flight no faster, or one that differs far from that turn, except `asking`."""
        return turn in self.vain or any(
            abs(turn[0] - segment) > REACH and other.is_vain(turn, self)
            for other, segment in self.related
            if other is not asking
        )


def search_segment_turns(
    scenario: Scenario,
    starts: Sequence[ShootingSolution],
    allowed: Callable[[int], bool],
    *,
    nodes: int = NODES,
    breadth: int = BREADTH,
) -> list[ShootingSolution]:
    """Return the further flights on the coarse grid, converged or not, that a local search finds.

    Args:
        scenario: the task.
        starts: flights of it on the coarse grid; those that did not converge are ignored.
        allowed: whether a number of whole turns between start and goal is of interest.
        nodes: steps of the whole flight.
        breadth: fastest flights whose neighbours are all solved for.
    """
    steps, found, optima = coarse_steps(scenario, nodes), [], list[_Optimum]()
    shape = Shape(steps, has_height_limits(scenario), tolerant=False)
    turns = [(segment, turn) for segment in range(len(steps)) for turn in (1, -1)]
    for shot in starts:
        _insert(optima, _Optimum(shot, deque(turns)))
    while (base := next((optimum for optimum in optima[:breadth] if optimum.left), None)) is not None:
        segment, turn = step = base.left.popleft()
        base.tried.append(step)
        if base.is_vain(step) or not allowed(base.shot.winding + turn):
            continue
        guess = turned_guess(base.shot.trajectory, steps, segment, turn)
        shot = solve_from(scenario, shape, base.shot.winding + turn, guess)
        found.append(shot)
        # The turns that made the last flight no faster come last.
        near = _Optimum(shot, deque([*base.left, *base.tried]), related=[(base, segment)])
        if not (shot.converged and near.duration < base.duration * (1 - SAME_TIME)):
            base.vain.add(step)
        if _insert(optima, near):
            base.related.append((near, segment))
    if optima:
        found.append(_from_stations(scenario, optima[0].shot, nodes))
    return found


def _from_stations(scenario: Scenario, shot: ShootingSolution, nodes: int) -> ShootingSolution:
    """Return the flight found from the passing times of a flight and from its tilts at the stations."""
    flight, ends = shot.trajectory, np.append(0, np.cumsum(shot.steps))
    times = np.linspace(0.0, flight.duration, len(flight.breakpoints))
    tilts = np.interp(times, flight.breakpoints[ends], flight.states[ends, 4])
    return solve_coarse_along(scenario, flight.breakpoints[ends[1:]], tilts, nodes=nodes)


def _insert(optima: list[_Optimum], found: _Optimum) -> bool:
    """Insert a converged flight into optima sorted by time, unless one of the same time is there; return whether."""
    time = found.duration
    new = found.shot.converged and all(abs(time - optimum.duration) > SAME_TIME * time for optimum in optima)
    if new:
        optima.append(found)
        optima.sort(key=operator.attrgetter("duration"))
    return new
