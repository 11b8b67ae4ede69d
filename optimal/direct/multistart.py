"""The search over local optima: every number of turns, several starts, the fastest flight.

Every start is solved on the coarse grid; only flights not much slower than the fastest go on to the
full grid, one of each kind. Windings are tried from few turns to many, and one is left out where its
turns alone take longer than the fastest flight found so far,

    2 pi |winding| / rate_max > T,

as no flight of it can win: a proof, and free. For `hoop` it spares |winding| = 3. Most others are
hopeless by the costates of a flight already found, see `optimal.direct.windings`: of random goals' seven
windings two or three remain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatgym.scenarios.scenario import Scenario
from optimal.direct.clearance import keep_clear
from optimal.direct.program import NODES
from optimal.direct.shooting import WINDINGS, ShootingSolution, solve_coarse, solve_fine
from optimal.direct.windings import SLACK, pruned_windings

STARTS = 3
"""Starts for each winding: one may fail or end in a slower optimum, and agreement can only be seen among several."""
AGREEMENT = 1e-4
"""Two flight times closer than this, relatively, are the same optimum."""
SAME = 1e-5
"""Two flights of one winding whose times on the coarse grid are closer than this, relatively, are one flight."""
MARGIN = 0.1
"""How much slower than the fastest a flight on the coarse grid may be, relatively, to go on to the full one:
up to one turn, on the named scenarios, the full grid shortens a flight by less than 2 %."""


@dataclass(frozen=True)
class Search:
    """What a search found.

    Attributes:
        shots: the flights that converged on the full grid, the fastest first.
        starts: starts tried, over all windings.
        agreed: how many of them ended within AGREEMENT of the fastest.
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
        scenario: what to fly.
        windings: whole turns to try.
        starts: starts for each winding, the first plain and the others drawn.
        seed: seed of the drawn starts.
        nodes: steps of the whole flight.

    Raises:
        ValueError: when there is no winding or no start.
    """
    tried = coarse_multistart(scenario, windings, starts=starts, seed=seed, nodes=nodes)
    flown: list[tuple[ShootingSolution, int]] = []
    iterations, fastest = sum(shot.iterations for shot in tried), math.inf
    for kind in distinct_optima(tried):
        point = shot = _refined(scenario, kind, nodes)
        # Rims only cost time: a point slower than a body that keeps clear of them need not be cleared.
        if point.converged and point.trajectory.duration < fastest * (1 + AGREEMENT):
            shot = keep_clear(scenario, point, nodes=nodes)
            fastest = min(fastest, shot.trajectory.duration if shot.converged else math.inf)
        iterations += shot.iterations - kind[0].iterations
        if shot.converged:
            flown.append((shot, len(kind)))
    flown.sort(key=lambda pair: pair[0].trajectory.duration)
    agreed = sum(count for shot, count in flown if shot.trajectory.duration <= fastest * (1 + AGREEMENT))
    return Search(tuple(shot for shot, _ in flown), len(tried), agreed, iterations)


def _refined(scenario: Scenario, kind: Sequence[ShootingSolution], nodes: int) -> ShootingSolution:
    """Return the flight on the full grid to which the first of a kind leads that does not lose its way.

    A flight on the coarse grid is one on the full grid too, so that what comes out slower is another local optimum.
    """
    fine = [solve_fine(scenario, kind[0], nodes=nodes)]
    while len(fine) < len(kind) and fine[-1].trajectory.duration > kind[0].trajectory.duration * (1 + SAME):
        fine.append(solve_fine(scenario, kind[len(fine)], nodes=nodes))
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
    """Return the flights on the coarse grid, converged or not, of all windings and starts that could still win.

    Args:
        scenario, windings, starts, seed, nodes: as for `search`; what is drawn for a start depends on no other.
        slack: how much slower than the fastest, relatively, still counts as winning.

    Raises:
        ValueError: when there is no winding or no start.
    """
    if not windings or starts < 1:
        raise ValueError(f"needs at least one winding and one start, got windings={windings!r}, starts={starts!r}")
    tried: list[ShootingSolution] = []
    left, fastest = sorted(dict.fromkeys(windings), key=abs), math.inf
    while left and 2 * math.pi * abs(left[0]) / scenario.quadrotor.rate_max <= fastest * (1 + slack):
        winding = left.pop(0)
        for i in range(starts):
            draw = np.random.default_rng((seed, winding % 2**32, i)) if i else None
            shot = solve_coarse(scenario, winding, nodes=nodes, generator=draw)
            tried.append(shot)
            if shot.converged:
                fastest = min(fastest, shot.trajectory.duration)
            if shot.converged and i == 0:
                out = pruned_windings(scenario, shot, fastest * (1 + slack), {winding, *left})
                left = [other for other in left if other not in out]
                if winding in out:
                    break
    return tried


def distinct_optima(tried: Sequence[ShootingSolution]) -> list[list[ShootingSolution]]:
    """Return the flights fast enough to go on, alike ones together, the fastest first."""
    found: list[list[ShootingSolution]] = []
    converged = sorted((shot for shot in tried if shot.converged), key=lambda shot: shot.trajectory.duration)
    for shot in converged:
        if shot.trajectory.duration > converged[0].trajectory.duration * (1 + MARGIN):
            break
        for kind in found:
            alike = shot.trajectory.duration <= kind[0].trajectory.duration * (1 + SAME)
            if kind[0].winding == shot.winding and alike:
                kind.append(shot)
                break
        else:
            found.append([shot])
    return found
