"""One solve of direct multiple shooting: a flight of one winding from one initial guess.

The program (`optimal.direct.program`) is solved on two grids. A step of the solver on the coarse grid, with a quarter
of the steps, costs a quarter. Its flight, divided into four times as many steps, is a feasible and nearly optimal start
on the full grid.

The problem has local optima, one family for each number of whole turns of the tilt. `optimal.direct.multistart` tries
them all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.guesses import first_guess, guess_along, upsampled_guess, warm_start
from optimal.direct.program import NODES, Shape, bounds, coarse_steps, layout, phase_steps, program
from optimal.direct.solver_process import call
from optimal.direct.transcription import has_height_limits
from optimal.flights.trajectory import Trajectory

WINDINGS = (0, 1, -1, 2, -2, 3, -3)
"""Windings to try, whole turns of the tilt, the smallest first."""


@dataclass(frozen=True)
class ShootingSolution:
    """The result of one solve from one initial guess.

    Attributes:
        converged: whether the solver reached its tolerances.
        message: the solver's own status, or that the call did not return.
        winding: whole turns of the tilt.
        trajectory: the flight at the last iterate; valid only if converged.
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

    @property
    def passings(self) -> Array:
        """The times at which it passes the hoops [s], shape (hoops,)."""
        return self.trajectory.breakpoints[np.cumsum(self.steps)[:-1]]


def solve_from(
    scenario: Scenario, shape: Shape, winding: int, guess: Array, *, warm: bool = False, clearance: float = 0.0
) -> ShootingSolution:
    """Run the solver once from a given guess; see `program` and `bounds` for the arguments."""
    stages, _, gaps, _, _ = layout(shape)
    found = call(program, (shape, warm), x0=guess, **bounds(scenario, shape, winding, clearance))
    h = found.x[stages.departures]
    trajectory = Trajectory(
        breakpoints=np.append(0.0, np.cumsum(h)),
        states=found.x[stages.states],
        controls=found.x[stages.controls],
        quadrotor=scenario.quadrotor,
    )
    return ShootingSolution(
        converged=found.converged,
        message=found.message,
        winding=winding,
        trajectory=trajectory,
        costates=found.multipliers[gaps[:, :5]],
        iterations=found.iterations,
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
    """Solve one winding of a scenario from one guess on the coarse grid; see `solve_winding` for the arguments."""
    steps = coarse_steps(scenario, nodes)
    guess = first_guess(scenario, steps, winding, generator)
    return solve_from(scenario, Shape(steps, has_height_limits(scenario), tolerant), winding, guess)


def solve_fine(
    scenario: Scenario, coarse: ShootingSolution, *, nodes: int = NODES, tolerant: bool = False
) -> ShootingSolution:
    """Solve on the full grid from a result of `solve_coarse`; a result that did not converge is returned unchanged."""
    if not coarse.converged:
        return coarse
    steps = phase_steps(scenario, nodes)
    guess = upsampled_guess(coarse.trajectory, coarse_steps(scenario, nodes), steps)
    shape = Shape(steps, has_height_limits(scenario), tolerant)
    fine = solve_from(scenario, shape, coarse.winding, guess, warm=True)
    return replace(fine, iterations=coarse.iterations + fine.iterations)


def solve_winding(
    scenario: Scenario,
    winding: int = 0,
    *,
    nodes: int = NODES,
    tolerant: bool = False,
    generator: np.random.Generator | None = None,
) -> ShootingSolution:
    """Solve one winding of a scenario from one guess, on the coarse grid and then on the full grid.

    Args:
        scenario: the task.
        winding: whole turns of the tilt between start and goal, positive towards +x.
        nodes: steps of the whole flight, distributed over the phases.
        tolerant: end anywhere within the scenario's tolerance instead of exactly at rest.
        generator: samples a random guess; None takes the default guess.
    """
    coarse = solve_coarse(scenario, winding, nodes=nodes, tolerant=tolerant, generator=generator)
    return solve_fine(scenario, coarse, nodes=nodes, tolerant=tolerant)


def solve_tolerant(scenario: Scenario, shot: ShootingSolution) -> ShootingSolution:
    """Solve for the flight near another one, on its grid, that may end anywhere within the tolerance."""
    rims = bool(scenario.hoops) and scenario.quadrotor.radius > 0
    shape = Shape(shot.steps, has_height_limits(scenario), tolerant=True, rims=rims)
    return solve_from(scenario, shape, shot.winding, warm_start(shot.trajectory, shot.steps), warm=True)


def solve_along(
    scenario: Scenario, passing_times: Array, tilts: Array, *, places: Array | None = None, nodes: int = NODES
) -> ShootingSolution:
    """Solve a scenario from a guess that passes the stations at given times with given tilts, on both grids.

    Args:
        scenario: the task.
        passing_times: times at which hoops and goal are reached, increasing [s], shape (H+1,).
        tilts: tilts at equal distances in time from start to goal, whole turns counted [rad], shape (n,), n >= 2. The
            last one, rounded to whole turns, is the winding.
        places: distances from the centres of the gaps, along `Hoop.across` [m], shape (H,); None for the centres.
        nodes: steps of the whole flight, distributed over the phases.

    Raises:
        ValueError: for times that do not increase from 0, a wrong number of times or places, or fewer than two tilts.
    """
    return solve_fine(
        scenario, solve_coarse_along(scenario, passing_times, tilts, places=places, nodes=nodes), nodes=nodes
    )


def solve_coarse_along(
    scenario: Scenario, passing_times: Array, tilts: Array, *, places: Array | None = None, nodes: int = NODES
) -> ShootingSolution:
    """Solve as `solve_along` does, on the coarse grid only."""
    times, hoops = np.asarray(passing_times, dtype=np.float64), len(scenario.hoops)
    if times.shape != (hoops + 1,) or not np.all(np.diff(times, prepend=0.0) > 0):
        raise ValueError(f"passing_times must be {hoops + 1} times [s] that increase from 0, got {passing_times!r}")
    if np.ndim(tilts) != 1 or len(tilts) < 2:
        raise ValueError(f"tilts must be at least two angles [rad], got {tilts!r}")
    if places is not None and np.shape(places) != (hoops,):
        raise ValueError(f"places must be {hoops} distances [m], one a hoop, got {places!r}")
    steps = coarse_steps(scenario, nodes)
    guess = guess_along(scenario, steps, times, np.asarray(tilts), places)
    shape = Shape(steps, has_height_limits(scenario), tolerant=False)
    return solve_from(scenario, shape, round(tilts[-1] / (2 * np.pi)), guess)
