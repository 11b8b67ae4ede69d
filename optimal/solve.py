"""The front door: a scenario in, a certified optimum out, by the road of one's choice."""

from __future__ import annotations

import difflib
import math
import time
from collections.abc import Sequence

import numpy as np

from flatgym.catalogue import ScenarioLike, scenario
from flatgym.scenario import Scenario
from optimal.certificate import certify
from optimal.planning import paper_outer_paths, plan
from optimal.shooting import NODES, WINDINGS, shoot
from optimal.solution import Solution, SolveFailed, Status

METHODS = ("shooting", "flat")
AGREEMENT = 1e-4
"""Two flight times closer than this, relatively, are the same optimum."""


def solve(
    problem: ScenarioLike,
    method: str = "shooting",
    *,
    windings: Sequence[int] = WINDINGS,
    starts: int = 1,
    seed: int = 0,
    nodes: int = NODES,
    checks: str = "certified",
    intervals: int | None = None,
    throw: bool = True,
) -> Solution:
    """Return the fastest flight of a scenario from exact rest to exact rest.

    Args:
        problem: a scenario or its name.
        method: "shooting" (direct multiple shooting with the exact step) or "flat" (the paper's
            eq. (10) with its own outer paths).
        windings: whole turns to try; shooting only.
        starts: starts for each winding, the first plain and the others drawn; shooting only.
        seed: seed of the drawn starts.
        nodes: steps of the whole flight; shooting only.
        checks: "certified", or "nodes" for the flat road as published; flat only.
        intervals: pieces of the flat functions; None takes `plan`'s; flat only.
        throw: raise SolveFailed rather than return a solution that is not solved.

    Raises:
        SolveFailed: with the problem and the result, when no certified flight was found.
        ValueError: for an unknown scenario or method, or a scenario the paper has no outer paths for.
    """
    task = scenario(problem)
    if method not in METHODS:
        near = difflib.get_close_matches(str(method), METHODS, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown method {method!r}; known: {', '.join(METHODS)}{hint}")
    begun = time.perf_counter()
    if method == "flat":
        solution = _flat(task, checks, intervals, begun)
    else:
        solution = _shooting(task, windings, starts, seed, nodes, begun)
    if throw and solution.status not in (Status.SOLVED, Status.LIMITS_AT_NODES_ONLY):
        raise SolveFailed(task, solution)
    return solution


def _shooting(task: Scenario, windings: Sequence[int], starts: int, seed: int, nodes: int, begun: float) -> Solution:
    if not windings or starts < 1:
        raise ValueError(f"needs at least one winding and one start, got windings={windings!r}, starts={starts!r}")
    generator = np.random.default_rng(seed)
    shots = [
        shoot(task, winding, nodes=nodes, generator=generator if i else None)
        for i in range(starts)
        for winding in windings
    ]
    good = sorted((shot for shot in shots if shot.converged), key=lambda shot: shot.trajectory.duration)
    # Only the fastest counts: a slower flight that is certified would not be the optimum.
    chosen = good[0] if good else None
    certificate = certify(chosen.trajectory if chosen else None, task)
    status = Status.NOT_CONVERGED if not good else Status.SOLVED if certificate.holds() else Status.NOT_CERTIFIED
    duration = chosen.trajectory.duration if chosen and status is Status.SOLVED else math.inf
    return Solution(
        scenario=task,
        method="shooting",
        time=duration,
        status=status,
        winding=chosen.winding if chosen else 0,
        trajectory=chosen.trajectory if chosen else None,
        certificate=certificate,
        iterations=sum(shot.iterations for shot in shots),
        solve_time=time.perf_counter() - begun,
        starts=len(shots),
        agreed=sum(shot.trajectory.duration <= good[0].trajectory.duration * (1 + AGREEMENT) for shot in good),
    )


def _flat(task: Scenario, checks: str, intervals: int | None, begun: float) -> Solution:
    outer_paths = paper_outer_paths(task)
    found = plan(outer_paths.paths, task.quadrotor, ends=outer_paths.ends, intervals=intervals, checks=checks)
    certificate = certify(found.trajectory, task)
    if not found.converged:
        status = Status.NOT_CONVERGED
    elif checks == "nodes":
        status = Status.LIMITS_AT_NODES_ONLY
    else:
        status = Status.SOLVED if certificate.holds() else Status.NOT_CERTIFIED
    trusted = status in (Status.SOLVED, Status.LIMITS_AT_NODES_ONLY)
    return Solution(
        scenario=task,
        method="flat",
        time=found.time if trusted else math.inf,
        status=status,
        winding=0,
        trajectory=found.trajectory,
        certificate=certificate,
        iterations=found.iterations,
        solve_time=time.perf_counter() - begun,
        starts=1,
        agreed=int(trusted),
    )
