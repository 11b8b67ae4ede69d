"""Path planning and path following as one problem with fixed ends, paper eq. (10), for any flat system.

The path is y(s) = sum p_i(s) y_i(s), p_i >= 0, sum p_i = 1, travelled with ds/dt = sqrt(b(s)):

    minimise    T = integral of ds / sqrt(b)                                                (7)
    subject to  b > 0,  states and inputs within their limits,                              (10)
                at rest at s = 0 and s = 1.

The paper misprints the time element as ds/sqrt(s). `optimal.flat.program.transcription` discretises the problem and
`optimal.flat.refinement` solves it. `checks="nodes"` is the paper's discretisation, which violates limits between
its nodes. `checks="certified"` keeps the limits in continuous time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from flatgym.quadrotor import Quadrotor
from optimal.flat.initial_guess import central, motion, speed_unit
from optimal.flat.problem import PlanningProblem
from optimal.flat.projection import Motion
from optimal.flat.refinement import INTERVALS, optimise
from optimal.flat.solution import FlatSolution
from optimal.paths.curves import Path
from optimal.paths.regularity import StandstillError, require_regular, require_smooth
from optimal.systems import FlatSystem, PlanarQuadrotor

STANDSTILL = 1e-6
"""|dy/ds| up to which a path counts as standing still [m]."""


def plan(
    outer_paths: Sequence[Path],
    system: FlatSystem | Quadrotor | None = None,
    *,
    ends: ArrayLike | None = None,
    conditions: str = "explicit",
    checks: str = "certified",
    intervals: int = INTERVALS,
    start: Motion | None = None,
    slowest: float = math.inf,
) -> FlatSolution:
    """Return the fastest motion between outer paths, from rest to rest.

    Args:
        outer_paths: k >= 2 paths that answer `path(s, order)`, with continuous derivatives below the order of the
            system, at rest (y' = 0) at s = 0 and s = 1. `optimal.paths.corridors` builds them.
        system: the flat system with its limits; a planar quadrotor by default.
        ends: the weights of all paths at s = 0 and s = 1, shape (2, k); 1/k by default.
        conditions: "explicit": the state at both ends is a constraint. "implicit": all derivatives of the weights
            below the order of the system vanish there, as those of the paths must (section II-E).
        checks: "certified": limits hold in continuous time. "nodes": as published, limits hold at grid nodes only;
            the solution reports the violation between them.
        intervals: intervals of the first grid, at least 4.
        start: a motion between the outer paths, which is projected on them; by default the slow motion along the
            central path of section II-E. The solution has as many turns of the vehicle as its start.
        slowest: a motion that is not faster than this on the first grid is not refined, and there is no solution [s].

    Returns:
        The solution. If the solve fails, its time is inf and its status gives the reason.

    Raises:
        ValueError: for arguments that do not define a problem, and for a start that leaves the corridor or is a motion
            of another system.

    Source: eq. (10), started as in section II-E.
    """
    problem = pose(outer_paths, system, ends, conditions, checks)
    if len(outer_paths) < 2:
        raise ValueError(f"outer_paths must be at least two paths, got {len(outer_paths)}; `follow` takes a single one")
    for i, path in enumerate(problem.outer_paths):
        require_regular(path, f"path {i}")
        require_smooth(path, problem.system.order, f"path {i}")
    if start is not None:
        _require_system(problem, start)
    return optimise(problem, intervals, start, slowest)


def pose(
    outer_paths: Sequence[Path],
    system: FlatSystem | Quadrotor | None,
    ends: ArrayLike | None,
    conditions: str,
    checks: str,
) -> PlanningProblem:
    """Return the validated problem; arguments as of `plan`, with k >= 1 outer paths.

    Raises:
        ValueError: for arguments that do not define a problem.
    """
    system = PlanarQuadrotor(system or Quadrotor()) if not isinstance(system, FlatSystem) else system
    paths = tuple(outer_paths)
    weights = np.full((2, len(paths)), 1 / len(paths)) if ends is None else np.asarray(ends, dtype=np.float64)
    if checks not in ("certified", "nodes"):
        raise ValueError(f'checks must be "certified" or "nodes", got {checks!r}')
    if conditions not in ("explicit", "implicit"):
        raise ValueError(f'conditions must be "explicit" or "implicit", got {conditions!r}')
    if weights.shape != (2, len(paths)) or not (
        np.all(weights >= 0) and np.allclose(weights.sum(axis=1), 1, rtol=0, atol=1e-9)
    ):
        raise ValueError(f"ends must be {len(paths)} weights >= 0 with sum 1 at either end, got {weights.tolist()}")
    for i, path in enumerate(paths):
        if np.shape(path(0.0)) != (len(system.outputs),):
            raise ValueError(
                f"path {i} has {np.shape(path(0.0))[-1]} coordinates, but {type(system).__name__} needs "
                f"{len(system.outputs)}: {', '.join(system.outputs)}"
            )
    # A lifted attitude is constrained at the ends by its own bounds. Without one, the derivatives must vanish.
    explicit = conditions == "explicit" and bool(system.lift().names)
    problem = PlanningProblem(system, paths, weights, checks == "certified", 1 if explicit else system.order - 1)
    _require_rest(problem, explicit)
    _require_moving(problem)
    return replace(problem, speed_unit=speed_unit(problem))


def _require_system(problem: PlanningProblem, start: Motion) -> None:
    """Refuse a start that is a motion of another system."""
    system = problem.system
    flown = getattr(start, "system", None)
    vehicle = getattr(start, "quadrotor", None)
    if flown is None and vehicle is not None:
        flown = PlanarQuadrotor(vehicle)
    if flown is not None and flown != system:
        raise ValueError(f"start is a motion of {flown}, but the plan is for {system}")


def _require_rest(problem: PlanningProblem, explicit: bool) -> None:
    """Refuse outer paths that are not at rest at both ends; implicit conditions include all orders below beta."""
    for s, weights in zip((0.0, 1.0), problem.ends, strict=True):
        for order in range(1, 2 if explicit else problem.system.order):
            values = [w * path(s, order) for w, path in zip(weights, problem.outer_paths, strict=True)]
            derivative = np.sum(values, axis=0)
            if not np.all(np.abs(derivative) <= 1e-9):
                raise ValueError(
                    f"the outer paths must be at rest at both ends (section II-E), got derivative {order} with respect "
                    f"to s = {derivative} at s = {s:g}; reparametrise them with `optimal.paths.curves.Resting`"
                )


def _require_moving(problem: PlanningProblem) -> None:
    """Refuse outer paths whose central path stands still between its ends, for example if start and goal coincide."""
    s = np.linspace(0.02, 0.98, 193)
    speed = np.linalg.norm(motion(problem, central(problem, 4)).path(s, 1), axis=-1)
    if not np.all(speed > STANDSTILL):
        raise StandstillError(
            f"the central path between the outer paths stands still at s = {s[np.argmin(speed)]:.2f}, but y' must not "
            "vanish between the ends; move the outer paths, or change the weights at the ends"
        )
