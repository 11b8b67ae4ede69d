"""Free end time direct multiple shooting: the optimum T*, winding by winding.

A flight is a sequence of phases, one more than there are hoops; phase i has N_i steps of equal,
unknown length h_i, so that hoop i is crossed at a node:

    minimise  sum N_i h_i
    such that X[k+1] = step(X[k], U[k], h_i),  X[0] at rest at the start,
              X[N] at rest at the goal with theta = 2 pi winding,
              (p - c) . d = 0, |(p - c) . across| <= gap, v . d >= 0   at each hoop (c, d),
              thrust_min <= f <= thrust_max, |omega| <= rate_max, floor <= z <= ceiling.

Most of the way is gone on a grid of a quarter of the steps, where a step of the solver costs a
quarter; its flight, flown in four times as many steps, is a feasible and nearly optimal start on
the full grid.

The problem has local optima, one family for each number of turns, so `solve_winding` solves one winding
from one start and the front door tries them all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct import transcription as tr
from optimal.direct.guesses import first_guess, upsampled_guess
from optimal.direct.program import NODES, Shape, bounds, coarse_steps, layout, phase_steps, program
from optimal.flights.trajectory import Trajectory

WINDINGS = (0, 1, -1, 2, -2, 3, -3)
"""Whole turns of the tilt to try, the fewest first."""


@dataclass(frozen=True)
class ShootingSolution:
    """What one solve from one start gave.

    Attributes:
        converged: whether the solver reached its tolerances.
        message: the solver's own word for how it ended.
        winding: whole turns made.
        trajectory: the flight at the last iterate (not to be trusted unless converged).
        costates: multipliers of the step equations, shape (N, 5).
        iterations: of the solver, on both grids.
        steps: of each phase.
    """

    converged: bool
    message: str
    winding: int
    trajectory: Trajectory
    costates: Array
    iterations: int
    steps: tuple[int, ...]


def solve_from(
    scenario: Scenario, shape: Shape, winding: int, guess: Array, *, warm: bool = False, clearance: float = 0.0
) -> ShootingSolution:
    """Run the solver once, from a given start; see `program` and `bounds` for the arguments."""
    run, (stages, _, gaps, _, _) = program(shape, warm), layout(shape)
    result = run(x0=guess, **bounds(scenario, shape, winding, clearance))
    stats, values = run.stats(), np.array(result["x"]).ravel()
    h = values[stages.departures]
    trajectory = Trajectory(
        breakpoints=np.append(0.0, np.cumsum(h)),
        states=values[stages.states],
        controls=values[stages.controls],
        quadrotor=scenario.quadrotor,
    )
    return ShootingSolution(
        converged=stats["success"],
        message=stats["unified_return_status"],
        winding=winding,
        trajectory=trajectory,
        costates=np.array(result["lam_g"]).ravel()[gaps[:, :5]],
        iterations=stats["iter_count"],
        steps=shape.steps,
    )


def solve_coarse(
    scenario: Scenario,
    winding: int = 0,
    *,
    nodes: int = NODES,
    tolerant: bool = False,
    generator: np.random.Generator | None = None,
) -> ShootingSolution:
    """Solve one winding of a scenario from one start on the coarse grid; see `solve_winding` for the arguments."""
    steps = coarse_steps(scenario, nodes)
    guess = first_guess(scenario, steps, winding, generator)
    return solve_from(scenario, Shape(steps, tr.limited(scenario), tolerant), winding, guess)


def solve_fine(
    scenario: Scenario, rough: ShootingSolution, *, nodes: int = NODES, tolerant: bool = False
) -> ShootingSolution:
    """Solve on the full grid from the flight that `solve_coarse` found; what did not converge is returned as it is."""
    if not rough.converged:
        return rough
    steps = phase_steps(scenario, nodes)
    guess = upsampled_guess(rough.trajectory, coarse_steps(scenario, nodes), steps)
    fine = solve_from(scenario, Shape(steps, tr.limited(scenario), tolerant), rough.winding, guess, warm=True)
    return replace(fine, iterations=rough.iterations + fine.iterations)


def solve_winding(
    scenario: Scenario,
    winding: int = 0,
    *,
    nodes: int = NODES,
    tolerant: bool = False,
    generator: np.random.Generator | None = None,
) -> ShootingSolution:
    """Solve one winding of a scenario from one start.

    Args:
        scenario: what to fly.
        winding: whole turns of the tilt between start and goal, positive towards +x.
        nodes: steps of the whole flight, shared out over the phases.
        tolerant: end anywhere within the scenario's tolerance instead of exactly at rest.
        generator: draws a random start; None takes the plain one.
    """
    rough = solve_coarse(scenario, winding, nodes=nodes, tolerant=tolerant, generator=generator)
    return solve_fine(scenario, rough, nodes=nodes, tolerant=tolerant)
