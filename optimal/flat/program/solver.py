"""One solve of eq. (10) on a fixed grid, by Ipopt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flatgym.quadrotor import Array
from optimal.flat.problem import UNBOUNDED, Iterate, PlanningProblem, TrustRegion
from optimal.flat.program.parameters import apply_trust_region, parameters, program_bounds
from optimal.flat.program.transcription import parametric_program

SUCCESS = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
"""Return statuses of Ipopt that count as converged."""
USABLE = (*SUCCESS, "Maximum_Iterations_Exceeded", "Search_Direction_Becomes_Too_Small")
"""Return statuses of Ipopt whose point is used further. The final motion is verified independently."""


def solve_program(
    problem: PlanningProblem,
    start: Iterate,
    margins: Array | None = None,
    trust_region: TrustRegion = UNBOUNDED,
) -> Iterate:
    """Solve the program from a start, on the grid of the start.

    Args:
        problem: the problem.
        start: the initial point.
        margins: tightening of the greatest and of the least values of each limit on every interval,
            relative to the scale of the limit, shape (2, limits, N); zero by default.
        trust_region: how far the unknowns may move from the start.

    Returns:
        The point where Ipopt stopped. Its outcome may be one that is not in SUCCESS.
    """
    nodes, paths = start.nodes, len(problem.outer_paths)
    if margins is None:
        margins = np.zeros((2, len(problem.system.bounds[0]), len(nodes) - 1))
    solver = parametric_program(problem.system, paths, len(nodes) - 1, problem.certified)
    guess = np.concatenate([start.weights.ravel(), start.squared_speed, start.lifted.ravel()])
    bounds = program_bounds(problem, start, margins)
    apply_trust_region(bounds, guess, problem, start, trust_region)
    if start.multipliers is not None:
        bounds |= zip(("lam_x0", "lam_g0"), start.multipliers, strict=True)
    result = solver(x0=guess, p=parameters(problem, tuple(nodes.tolist())), **bounds)
    parts = np.split(np.array(result["x"]).ravel(), np.cumsum([start.weights.size, start.squared_speed.size]))
    stats = solver.stats()
    # Ipopt relaxes bounds by 1e-8. Clipping keeps the path in the corridor exactly.
    return replace(
        start,
        weights=np.clip(parts[0].reshape(start.weights.shape), 0, 1),
        squared_speed=parts[1],
        lifted=parts[2].reshape(start.lifted.shape),
        multipliers=(result["lam_x"], result["lam_g"]),
        outcome=str(stats["return_status"]),
        iterations=start.iterations + int(stats["iter_count"]),
    )
