"""Multi-start search over local optima: all windings, several starts each, the fastest flight first.

Every start is solved on the coarse grid. One flight of each local optimum is refined on the full grid, unless it is
much slower than the fastest. Windings are tried in increasing order. A winding is skipped when its rotation alone takes
longer than the fastest flight found so far,

    2 pi |winding| / rate_max > T.

This test is a proof; for `hoop` it skips |winding| = 3. Most other windings are pruned by the costates of a flight
already found (`optimal.direct.windings`). Of the seven windings of a random goal, two or three remain.

With two or more hoops the total winding says little, because a turn on one segment may undo a turn on another. The
starts then take the smallest windings, and a local search adds or removes turns on single segments
(`optimal.direct.segment_turns`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatgym.scenarios.scenario import Scenario
from optimal.direct.clearance import keep_clear
from optimal.direct.program import NODES
from optimal.direct.segment_turns import search_segment_turns
from optimal.direct.shooting import WINDINGS, ShootingSolution, solve_coarse, solve_fine
from optimal.direct.windings import SLACK, pruned_windings

STARTS = 3
"""Starts for each winding: one start may fail or end in a slower optimum, and only several can show agreement."""
FURTHER = 2
"""Factor of the starts for a winding in which none has converged."""
AGREEMENT = 1e-4
"""Relative difference of two flight times below which they are the same optimum."""
COARSE_AGREEMENT = 1e-5
"""The same for two flights of one winding on the coarse grid."""
REFINED_MARGIN = 0.1
"""Flights on the coarse grid that are slower than the fastest by more than this, relatively, are not refined. On the
named scenarios with up to one turn the full grid shortens a flight by less than 2 %."""
SEGMENT_WINDINGS = 3
"""Windings of the starts for two or more hoops, the smallest ones."""
SEGMENT_MARGIN = 3e-3
"""The same with two or more hoops. The full grid shortens their flights by 0.03 % to 0.3 %."""


@dataclass(frozen=True)
class Search:
    """The result of a search.

    Attributes:
        shots: flights that converged on the full grid, the fastest first.
        starts: starts tried, over all windings.
        agreed: number of starts that ended within AGREEMENT of the fastest.
        iterations: of the solver, over all starts and grids.
    """

    shots: tuple[ShootingSolution, ...] = ()
    starts: int = 0
    agreed: int = 0
    iterations: int = 0


def search(
    scenario: Scenario,
    *,
    windings: Sequence[int] = WINDINGS,
    starts: int = STARTS,
    seed: int = 0,
    nodes: int = NODES,
) -> Search:
    """Return the flights found from all windings and starts.

    Args:
        scenario: the task.
        windings: whole turns to try; with two or more hoops, WINDINGS stands for any number.
        starts: starts for each winding, the first from the default guess and the others from random guesses; up to
            FURTHER times as many until one converges.
        seed: seed of the random guesses.
        nodes: steps of the whole flight.

    Raises:
        ValueError: when there is no winding or no start.
    """
    tried = coarse_multistart(scenario, windings, starts=starts, seed=seed, nodes=nodes)
    refined: list[tuple[ShootingSolution, int]] = []
    iterations, fastest = sum(shot.iterations for shot in tried), math.inf
    for alike in distinct_optima(tried):
        point = shot = _refined(scenario, alike, nodes)
        # Rims only cost time: a point that is slower than a body clear of the rims needs no solve with rims.
        if point.converged and point.trajectory.duration < fastest * (1 + AGREEMENT):
            shot = keep_clear(scenario, point)
            fastest = min(fastest, shot.trajectory.duration if shot.converged else math.inf)
        iterations += shot.iterations - alike[0].iterations
        if shot.converged:
            refined.append((shot, len(alike)))
    refined.sort(key=lambda pair: pair[0].trajectory.duration)
    agreed = sum(count for shot, count in refined if shot.trajectory.duration <= fastest * (1 + AGREEMENT))
    return Search(tuple(shot for shot, _ in refined), len(tried), agreed, iterations)


def _refined(scenario: Scenario, alike: Sequence[ShootingSolution], nodes: int) -> ShootingSolution:
    """Return the flight on the full grid of one local optimum, from the first coarse flight that leads there.

    A flight on the coarse grid is feasible on the full grid. A slower result is therefore another local optimum.
    """
    fine = [solve_fine(scenario, alike[0], nodes=nodes)]
    slowest = alike[0].trajectory.duration * (1 + COARSE_AGREEMENT)
    while len(fine) < len(alike) and fine[-1].trajectory.duration > slowest:
        fine.append(solve_fine(scenario, alike[len(fine)], nodes=nodes))
    return min((shot for shot in fine if shot.converged), key=lambda shot: shot.trajectory.duration, default=fine[0])


def coarse_multistart(
    scenario: Scenario,
    windings: Sequence[int],
    *,
    starts: int = STARTS,
    seed: int = 0,
    nodes: int = NODES,
    slack: float = SLACK,
) -> list[ShootingSolution]:
    """Return the flights on the coarse grid, converged or not, of all windings that could still be the fastest.

    Args:
        scenario, windings, starts, seed, nodes: as for `search`; a random guess does not depend on the other starts.
        slack: relative excess over the fastest time up to which a winding is still tried.

    Raises:
        ValueError: when there is no winding or no start.
    """
    if not windings or starts < 1:
        raise ValueError(f"needs at least one winding and one start, got windings={windings!r}, starts={starts!r}")
    tried: list[ShootingSolution] = []
    left, fastest = sorted(dict.fromkeys(windings), key=abs), math.inf
    segments, few = len(scenario.hoops) > 1, len(set(windings)) - SEGMENT_WINDINGS
    while left and 2 * math.pi * abs(left[0]) / scenario.quadrotor.rate_max <= fastest * (1 + slack):
        if segments and len(left) <= few and math.isfinite(fastest):
            break
        winding, known = left.pop(0), False
        for i in range(FURTHER * starts):
            if i >= starts and known:
                break
            generator = np.random.default_rng((seed, winding % 2**32, i)) if i else None
            shot = solve_coarse(scenario, winding, nodes=nodes, generator=generator)
            tried.append(shot)
            known = known or shot.converged
            if shot.converged:
                fastest = min(fastest, shot.trajectory.duration)
            if shot.converged and i == 0:
                pruned = pruned_windings(scenario, shot, fastest * (1 + slack), {winding, *left})
                left = [other for other in left if other not in pruned]
                if winding in pruned:
                    break
    if segments:
        every = set(windings) >= set(WINDINGS)
        tried += search_segment_turns(scenario, tried, lambda total: every or total in windings, nodes=nodes)
    return tried


def distinct_optima(tried: Sequence[ShootingSolution]) -> list[list[ShootingSolution]]:
    """Return the flights to be refined, grouped by local optimum, the fastest first."""
    found: list[list[ShootingSolution]] = []
    converged = sorted((shot for shot in tried if shot.converged), key=lambda shot: shot.trajectory.duration)
    for shot in converged:
        margin = SEGMENT_MARGIN if len(shot.steps) > 2 else REFINED_MARGIN
        if shot.trajectory.duration > converged[0].trajectory.duration * (1 + margin):
            break
        for alike in found:
            same_time = shot.trajectory.duration <= alike[0].trajectory.duration * (1 + COARSE_AGREEMENT)
            if alike[0].winding == shot.winding and same_time:
                alike.append(shot)
                break
        else:
            found.append([shot])
    return found
