"""The flat method for a scenario: a start in each class of flights, and corridors that follow the best.

The minimum thrust keeps flights with different turns of the tilt apart: no continuous change within the limits leads
from one to the other. Eq. (10) therefore ends in the class of its start. The starts are the local optima of direct
shooting on its coarse grid, the fastest of each winding. The first grid of a first corridor around each of them shows
which is the fastest, and the corridor follows that one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flatgym.scenarios.scenario import Scenario
from optimal.direct.clearance import keep_clear
from optimal.direct.multistart import AGREEMENT, coarse_multistart, distinct_optima
from optimal.direct.shooting import ShootingSolution
from optimal.flat.moving_corridor import CorridorStep, follow_flight
from optimal.paths.around import turns_round
from optimal.systems import PlanarQuadrotor

MARGIN, ALIKE = 5e-3, 1e-6
"""Starts slower than the fastest by more than this, relatively, are left out: the coarse grid of shooting adds up to
0.3 %. A start of opposite winding that is slower by up to ALIKE is the mirror image of a faster one."""
MOST_STARTS = 3
"""Most starts."""
NARROWER = 0.8
"""Width of the gaps at which flights turn round, as a share of the whole gap."""

BODY_MARGIN = 5e-3
"""Growth of a body's radius for the starts, so that outer paths close to the flight are clear of the rims [m]."""


@dataclass(frozen=True, eq=False)
class FlatSearch:
    """The flights of the flat method for a scenario.

    Attributes:
        steps: corridors and flights, each faster than the one before; empty if no start leads to a certified flight.
        winding: whole turns of the tilt of its start.
        starts: number of starts.
        agreed: number of starts that lead to a time within AGREEMENT of the best.
    """

    steps: tuple[CorridorStep, ...] = ()
    winding: int = 0
    starts: int = 0
    agreed: int = 0


def search(
    scenario: Scenario, windings: Sequence[int], callback: Callable[[CorridorStep], object] | None = None
) -> FlatSearch:
    """Return the corridors and flights that lead to the fastest flight found.

    Args:
        scenario: the scenario.
        windings: whole turns of the tilt to try.
        callback: called with each corridor and its flight as soon as it is found.

    Raises:
        ValueError: for no windings, and for a vehicle that is not flat.
    """
    PlanarQuadrotor(scenario.quadrotor)  # refuses a vehicle without gravity
    report = callback or (lambda _: None)
    starts = starting_flights(scenario, windings)
    first, slowest = [], math.inf
    for shot in starts:
        run = follow_flight(scenario, shot.trajectory, shot.passings, slowest=slowest)
        if (step := next(run, None)) is not None:
            report(step)
            first.append((step, shot, run))
            slowest = min(slowest, step.solution.first_time * (1 + AGREEMENT))
    if not first:
        return FlatSearch(starts=len(starts))
    step, shot, run = min(first, key=lambda found: found[0].solution.time)
    steps = [step]
    for step in run:
        steps.append(step)
        report(step)
    limit = steps[-1].solution.time * (1 + AGREEMENT)
    agreed = 1 + sum(step.solution.time <= limit for step, other, _ in first if other is not shot)
    return FlatSearch(tuple(steps), shot.winding, len(starts), agreed)


def starting_flights(scenario: Scenario, windings: Sequence[int]) -> list[ShootingSolution]:
    """Return a flight of each winding that can be the fastest, the fastest first; bodies are clear of the rims.

    A flight that turns round at a hoop touches its line at one instant, and one nearby crosses it twice, on both sides.
    Such flights are those of a scenario with narrower gaps, so that the flight nearby crosses within the gap.
    """
    scenario = _with_larger_body(scenario)
    shots = _fastest(scenario, windings)
    if any(_turns_round(scenario, shot) for shot in shots):
        return _fastest(scenario.narrowed(NARROWER), windings)
    return shots


def _with_larger_body(scenario: Scenario) -> Scenario:
    """Return a scenario whose body is larger by BODY_MARGIN, as far as the gaps allow; a point stays a point."""
    body = scenario.quadrotor
    if body.radius == 0 or not scenario.hoops:
        return scenario
    room = min(hoop.half_gap(body.radius) for hoop in scenario.hoops)
    return replace(scenario, quadrotor=replace(body, radius=body.radius + min(BODY_MARGIN, room / 2)))


def _fastest(scenario: Scenario, windings: Sequence[int]) -> list[ShootingSolution]:
    found: dict[int, ShootingSolution] = {}
    for alike in distinct_optima(coarse_multistart(scenario, windings)):
        shot = keep_clear(scenario, alike[0])
        best = found.get(shot.winding)
        if shot.converged and (best is None or shot.trajectory.duration < best.trajectory.duration):
            found[shot.winding] = shot
    fastest = min((shot.trajectory.duration for shot in found.values()), default=math.inf)
    shots = [shot for shot in found.values() if shot.trajectory.duration <= fastest * (1 + MARGIN)]
    shots.sort(key=lambda shot: shot.trajectory.duration)
    distinct = [shot for i, shot in enumerate(shots) if not any(_mirrored(shot, other) for other in shots[:i])]
    return distinct[:MOST_STARTS]


def _mirrored(shot: ShootingSolution, other: ShootingSolution) -> bool:
    """Return whether a flight is as fast as another one that turns the other way round."""
    same_time = shot.trajectory.duration <= other.trajectory.duration * (1 + ALIKE)
    return shot.winding == -other.winding and same_time


def _turns_round(scenario: Scenario, shot: ShootingSolution) -> bool:
    """Return whether a flight turns round at a hoop."""
    pairs = zip(scenario.hoops, shot.passings, strict=True)
    return any(turns_round(shot.trajectory(time, 1), hoop) for hoop, time in pairs)
