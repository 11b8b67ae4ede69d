"""The flat method for any scenario: corridors that follow the flight.

A flight of another method, of any quality, is the start. A corridor is laid around it, eq. (10) is solved in that
corridor from that flight, and a corridor is laid around the result, until a corridor does not confine its flight or the
gain is small. The gain of a corridor shows on the first grid, and a flight without gain there is not refined. Each
flight is kept only if it is certified and faster than the one before, so the times only fall.

A flight that touches no outer path, but for the ends of the gaps, which all its corridors share, is a local optimum
among all flights nearby. No other corridor around it contains a faster one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.flat.planning import plan
from optimal.flat.projection import OutsideCorridorError
from optimal.flat.solution import FlatSolution
from optimal.flat.trajectory import FlatTrajectory
from optimal.flights.certificate import Certificate, certify
from optimal.flights.trajectory import Flight
from optimal.paths.around import WIDTH, corridor_around, passings_of
from optimal.paths.corridors import Corridor
from optimal.paths.regularity import StandstillError
from optimal.paths.smoothing import smoothed

GAIN, LARGE_GAIN = 1e-4, 1e-2
"""Relative gain in time below which no further corridor is laid, and above which another one is laid in any case: the
trust region around the start may have confined the flight, not the corridor."""
MOST_CORRIDORS = 6
"""Most corridors around the flights that follow one start."""
CONTACT, AT_HOOPS, INSTANTS = 1e-3, 0.05, 2000
"""Weight up to which a flight touches the outer path opposite; time from a hoop within which it touches the end of the
gap [s]; instants that are looked at."""
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
        certificate: the certificate of the flight, which holds.
    """

    corridor: Corridor
    solution: FlatSolution
    certificate: Certificate


def follow_flight(
    scenario: Scenario,
    start: Flight,
    passings: Array | None = None,
    *,
    width: float = WIDTH,
    most: int = MOST_CORRIDORS,
    slowest: float = math.inf,
) -> Iterator[CorridorStep]:
    """Yield corridors around a flight and the certified flights found in them, each faster than the one before.

    Args:
        scenario: the scenario.
        start: a flight from rest to rest through all hoops.
        passings: the times at which it passes the hoops [s], shape (hoops,); by default its replay's.
        width: room to either side of a flight [m].
        most: most corridors.
        slowest: a first flight that is not faster than this on the first grid ends the sequence unrefined [s].
    """
    flight, fastest = start, math.inf
    times = passings_of(flight, scenario) if passings is None else passings
    for _ in range(most):
        motion = smoothed(flight, WINDOW, times)
        corridor = corridor_around(motion, scenario, times, width)
        intervals = BLOCK * math.ceil(motion.duration / INTERVAL / BLOCK)
        try:
            found = plan(
                corridor.paths,
                scenario.quadrotor,
                ends=corridor.ends,
                intervals=intervals,
                start=motion,
                slowest=slowest,
            )
        except (OutsideCorridorError, StandstillError):  # no smooth path surrounds a flight that turns on the spot
            break
        if found.trajectory is None or found.time >= fastest:
            break
        certificate = certify(found.trajectory, scenario)
        if not certificate.holds():
            break
        yield CorridorStep(corridor, found, certificate)
        gain, near = 1 - found.time / fastest, found.time > flight.duration * (1 - LARGE_GAIN)
        flight, fastest, slowest = found.trajectory, found.time, found.first_time * (1 - GAIN)
        times = passings_of(flight, scenario)
        if gain < GAIN or len(times) < len(scenario.hoops) or (near and not confined(found.trajectory, times)):
            break


def confined(flight: FlatTrajectory, passings: Array) -> bool:
    """Return whether a flight touches an outer path of its corridor away from hoops.

    Args:
        flight: the flight.
        passings: the times at which it passes hoops [s], shape (n,).
    """
    times = np.linspace(0.0, flight.duration, INSTANTS)
    first = flight.weights(flight.path_coordinate(times))
    weights = np.concatenate([first, 1 - first.sum(axis=-1, keepdims=True)], axis=-1)
    away = np.abs(times[:, None] - passings).min(axis=1, initial=math.inf) > AT_HOOPS
    return bool((weights[away] < CONTACT).any())
