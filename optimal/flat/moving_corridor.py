"""The flat method for any scenario: corridors that follow the flight.

A flight of another method, of any quality, is the start. A corridor is laid around it, eq. (10) is solved in that
corridor from that flight, and a corridor is laid around the result, until the gain is small. Each flight is kept only
if it is certified and faster than the one before, so the times only fall.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.flat.planning import plan
from optimal.flat.projection import OutsideCorridorError
from optimal.flat.solution import FlatSolution
from optimal.flights.certificate import certify
from optimal.flights.trajectory import Flight
from optimal.paths.around import corridor_around, passings_of
from optimal.paths.corridors import Corridor
from optimal.paths.smoothing import smoothed

GAIN = 1e-4
"""Relative gain in time below which no further corridor is laid."""
MOST_CORRIDORS = 6
"""Most corridors of one flight."""
WINDOW = 0.12
"""Time over which a flight is smoothed before a corridor is laid around it [s]."""
INTERVAL, BLOCK = 0.03, 16
"""Greatest duration of an interval [s]; numbers of intervals are multiples of BLOCK, so that programs are shared."""


@dataclass(frozen=True, eq=False)
class CorridorStep:
    """A corridor, and the certified flight found in it.

    Attributes:
        corridor: the corridor.
        solution: the flight between its outer paths.
    """

    corridor: Corridor
    solution: FlatSolution


def follow_flight(scenario: Scenario, start: Flight, passings: Array | None = None) -> Iterator[CorridorStep]:
    """Yield corridors around a flight and the certified flights found in them, each faster than the one before.

    Args:
        scenario: the scenario.
        start: a flight from rest to rest through all hoops.
        passings: the times at which it passes the hoops [s], shape (hoops,); by default its replay's.
    """
    flight, fastest = start, math.inf
    times = passings_of(flight, scenario) if passings is None else passings
    for _ in range(MOST_CORRIDORS):
        motion = smoothed(flight, WINDOW, times)
        corridor = corridor_around(motion, scenario, times)
        intervals = BLOCK * math.ceil(motion.duration / INTERVAL / BLOCK)
        try:
            found = plan(corridor.paths, scenario.quadrotor, ends=corridor.ends, intervals=intervals, start=motion)
        except OutsideCorridorError:  # smooth outer paths cannot surround a flight that turns on the spot
            break
        if found.trajectory is None or found.time >= fastest or not certify(found.trajectory, scenario).holds():
            break
        yield CorridorStep(corridor, found)
        gain, flight, fastest = 1 - found.time / fastest, found.trajectory, found.time
        times = passings_of(flight, scenario)
        if gain < GAIN or len(times) < len(scenario.hoops):
            break
