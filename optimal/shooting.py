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

The problem has local optima, one family for each number of turns, so `shoot` solves one winding
from one start and the front door tries them all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenario import Scenario
from optimal import transcription as tr
from optimal.stages import COLD, TOUCHING, WARM, Indices, Stages, solver, tightened
from optimal.trajectory import Trajectory

NODES = 100
"""Steps of a whole flight; with 400, T* falls by at most 3e-4 s on the named scenarios, 1.1e-5 s on the horizontals."""
LEAST_NODES = 25
"""Fewest steps of one phase."""
COARSENING = 4
"""How many steps of the full grid make one of the coarse grid."""
LEAST_COARSE = 12
"""Fewest steps of one phase on the coarse grid."""
LONGEST = 20.0
"""Longest phase the solver considers [s]."""
WINDINGS = (0, 1, -1, 2, -2, 3, -3)
"""Whole turns of the tilt to try, the fewest first."""
PLAIN_BEND = np.array([0.0, 0.0, 0.3])
"""Detour of the plain start in x [m], z [m], theta [rad]: a little tilt, because on vertical
displacements the mirror-symmetric flight is a saddle from which no gradient leads away."""

DRAWN_BEND = np.array([1.0, 1.0, 1.0])
"""Standard deviations of the detours of drawn starts in x [m], z [m], theta [rad]."""


@dataclass(frozen=True)
class Shape:
    """What makes two scenarios share a solver.

    Attributes:
        steps: steps of each phase.
        limited: whether there is a floor or a ceiling.
        tolerant: whether the flight may end anywhere within the tolerance.
        rims: whether the body must keep clear of the hoops' rims.
    """

    steps: tuple[int, ...]
    limited: bool
    tolerant: bool
    rims: bool = False


class Layout(NamedTuple):
    """Where things stand in a program: its stages, `constraints`, rows of the gaps (N, 6) and of the constraints."""

    stages: Stages
    further: list[tuple[int, str, int]]
    gaps: Indices
    rows: Indices
    height: int


@dataclass(frozen=True)
class Shot:
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


def phase_steps(scenario: Scenario, nodes: int = NODES) -> tuple[int, ...]:
    """Return the number of steps of each phase, shared out by the lengths of the legs."""
    lengths = tr.legs(scenario)[1]
    return tuple(max(LEAST_NODES, round(nodes * length / lengths.sum())) for length in lengths)


def coarse_steps(scenario: Scenario, nodes: int = NODES) -> tuple[int, ...]:
    """Return the number of steps of each phase on the coarse grid."""
    return tuple(max(LEAST_COARSE, -(-count // COARSENING)) for count in phase_steps(scenario, nodes))


@lru_cache(maxsize=64)
def program(shape: Shape, warm: bool = False) -> Any:
    """Return the parametric solver of one shape.

    Args:
        shape: what scenarios have in common.
        warm: whether it will be started near a solution.

    Unknowns are placed as `Stages` says; parameters: gravity, hoops (4, P-1), target (6,), rims (4, P-1).
    """
    stages, hoop_count = layout(shape).stages, len(shape.steps) - 1
    x, gravity, target = ca.SX.sym("x", stages.size), ca.SX.sym("g"), ca.SX.sym("target", 6)
    hoops, rims = ca.SX.sym("hoops", 4, hoop_count), ca.SX.sym("rims", 4, hoop_count)

    def expression(k: int, kind: str, i: int) -> Any:
        state = x[stages.states[k].tolist()]
        if kind == "rise":
            return state[1] + state[3] * x[int(stages.departures[k])] / 3
        if kind == "fall":
            return state[1] - state[3] * x[int(stages.arrivals[k - 1])] / 3
        if kind == "crossing":
            return tr.crossing(state, hoops[:, i])
        if kind == "rims":
            return tr.rim_distances(x[stages.arcs[k].tolist()], gravity, rims[:, i])
        return tr.arrival(state, target)

    problem = {
        "x": x,
        "p": ca.vertcat(gravity, ca.vec(hoops), target, ca.vec(rims)),
        "f": ca.dot(ca.DM(shape.steps), x[stages.lengths.tolist()]),
    }
    further = [(k, expression(k, kind, i), EQUATIONS[kind]) for k, kind, i in layout(shape).further]
    return solver(stages, problem, further, WARM if warm else COLD)


EQUATIONS: dict[str, list[bool]] = {
    "rise": [False],
    "fall": [False],
    "crossing": [True, False, False],
    "rims": [False] * 2 * tr.RIM_POINTS,
    "arrival": [False] * 3,
}
"""The kinds of constraints besides the steps, and which of their rows are equations."""


@lru_cache(maxsize=64)
def layout(shape: Shape) -> Layout:
    """Return where the unknowns and constraints of a shape stand."""
    stages, further = Stages(shape.steps), constraints(shape)
    gaps, rows, equations = stages.rows([(k, EQUATIONS[kind]) for k, kind, _ in further])
    return Layout(stages, further, gaps, rows, len(equations))


def constraints(shape: Shape) -> list[tuple[int, str, int]]:
    """Return the constraints besides the steps, ordered by stage, as (stage, kind, hoop).

    "rise" and "fall" are the inner control points of each arc's cubic, see `transcription.heights`.
    """
    stages = Stages(shape.steps)
    found = [(int(k), "crossing", i) for i, k in enumerate(stages.firsts[1:])]
    if shape.limited:
        found += [(k, "rise", 0) for k in range(stages.count)]
        found += [(k + 1, "fall", 0) for k in range(stages.count)]
    if shape.rims:
        for i, k in enumerate(stages.firsts[1:]):
            found += [(j, "rims", i) for j in range(int(k) - shape.steps[i] // 2, int(k) + shape.steps[i + 1] // 2)]
    if shape.tolerant:
        found.append((stages.count, "arrival", 0))
    return sorted(found)


def bounds(scenario: Scenario, shape: Shape, winding: int, clearance: float = 0.0) -> dict[str, Array]:
    """Return the bounds and parameters of `program` for one scenario and winding.

    Args:
        scenario: what to fly.
        shape: of the program.
        winding: whole turns of the tilt.
        clearance: how far beyond its radius the body keeps from the rims [m].
    """
    stages, further, _, rows, count = layout(shape)
    q = scenario.quadrotor
    low, high = tr.state_limits(scenario, stages.count + 1)
    if not shape.tolerant:
        low[:, -1] = high[:, -1] = scenario.goal_state + 2 * np.pi * winding * np.eye(5)[4]
    limits = np.zeros((2, count))
    if further:
        kept = [constraint_limits(scenario, kind, i, clearance) for _, kind, i in further]
        least, most = np.concatenate(kept, axis=1)
        limits[:, rows] = tightened(least, most, TOUCHING)
    low, high = tightened(low, high, TOUCHING)
    weakest, strongest = tightened(q.control_low, q.control_high)
    return {
        "lbx": stages.pack(np.full(len(shape.steps), 1e-5), low.T, weakest),
        "ubx": stages.pack(LONGEST / np.array(shape.steps), high.T, strongest),
        "lbg": limits[0],
        "ubg": limits[1],
        "p": np.concatenate(
            [
                [q.gravity],
                tr.hoop_parameters(scenario).T.ravel(),
                tr.arrival_target(scenario, winding),
                tr.rim_parameters(scenario).T.ravel(),
            ]
        ),
    }


def constraint_limits(scenario: Scenario, kind: str, hoop: int, clearance: float) -> Array:
    """Return least and greatest values of one of the `constraints`, shape (2, rows)."""
    if kind in ("rise", "fall"):
        return np.array(tr.height_limits(scenario))[:, None]
    if kind == "crossing":
        return np.array(tr.crossing_limits(scenario))[:, 3 * hoop : 3 * hoop + 3]
    if kind == "rims":
        rows = len(EQUATIONS[kind])
        return np.array([np.full(rows, (scenario.quadrotor.radius + clearance) ** 2), np.full(rows, np.inf)])
    return np.array([np.zeros(3), np.ones(3)])


def first_guess(
    scenario: Scenario, steps: tuple[int, ...], winding: int, generator: np.random.Generator | None = None
) -> Array:
    """Return a start for `program`: the plain one, or a bent and stretched one drawn from `generator`."""
    q, (_, lengths) = scenario.quadrotor, tr.legs(scenario)
    duration, bend = 2 * np.sqrt(lengths.sum() / (q.thrust_max - q.gravity)) + 0.3, PLAIN_BEND
    if generator is not None:
        duration *= generator.uniform(0.7, 1.8)
        bend = generator.normal(0.0, DRAWN_BEND)
    h = duration * lengths / lengths.sum() / np.array(steps)
    share = np.append(0.0, np.cumsum(np.repeat(h, steps))) / duration
    states = tr.guess_states(scenario, share, duration, winding, bend)
    controls = np.tile([q.gravity, np.clip(2 * np.pi * winding / duration, -q.rate_max, q.rate_max)], (sum(steps), 1))
    return Stages(steps).pack(h, states.T, controls)


def refined(flight: Trajectory, coarse: tuple[int, ...], steps: tuple[int, ...]) -> Array:
    """Return a flight of `coarse` steps a phase as a start for `program` on a grid of other `steps`."""
    ends = flight.breakpoints[np.append(0, np.cumsum(coarse))]
    h = np.diff(ends) / np.array(steps)
    time = np.append(0.0, np.cumsum(np.repeat(h, steps)))
    states, thrust = tr.resampled(flight, time)
    return Stages(steps).pack(h, states, np.column_stack([thrust, np.diff(states[:, 4]) / np.diff(time)]))


def packed(flight: Trajectory, steps: tuple[int, ...]) -> Array:
    """Return a flight as a start for `program` on its own grid."""
    return Stages(steps).pack(np.diff(flight.breakpoints)[Stages(steps).firsts], flight.states, flight.controls)


def attempt(
    scenario: Scenario, shape: Shape, winding: int, guess: Array, *, warm: bool = False, clearance: float = 0.0
) -> Shot:
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
    return Shot(
        converged=stats["success"],
        message=stats["unified_return_status"],
        winding=winding,
        trajectory=trajectory,
        costates=np.array(result["lam_g"]).ravel()[gaps[:, :5]],
        iterations=stats["iter_count"],
        steps=shape.steps,
    )


def explore(
    scenario: Scenario,
    winding: int = 0,
    *,
    nodes: int = NODES,
    tolerant: bool = False,
    generator: np.random.Generator | None = None,
) -> Shot:
    """Solve one winding of a scenario from one start on the coarse grid; see `shoot` for the arguments."""
    steps = coarse_steps(scenario, nodes)
    guess = first_guess(scenario, steps, winding, generator)
    return attempt(scenario, Shape(steps, tr.limited(scenario), tolerant), winding, guess)


def refine(scenario: Scenario, rough: Shot, *, nodes: int = NODES, tolerant: bool = False) -> Shot:
    """Solve on the full grid from the flight that `explore` found; what did not converge is returned as it is."""
    if not rough.converged:
        return rough
    steps = phase_steps(scenario, nodes)
    guess = refined(rough.trajectory, coarse_steps(scenario, nodes), steps)
    fine = attempt(scenario, Shape(steps, tr.limited(scenario), tolerant), rough.winding, guess, warm=True)
    return replace(fine, iterations=rough.iterations + fine.iterations)


def shoot(
    scenario: Scenario,
    winding: int = 0,
    *,
    nodes: int = NODES,
    tolerant: bool = False,
    generator: np.random.Generator | None = None,
) -> Shot:
    """Solve one winding of a scenario from one start.

    Args:
        scenario: what to fly.
        winding: whole turns of the tilt between start and goal, positive towards +x.
        nodes: steps of the whole flight, shared out over the phases.
        tolerant: end anywhere within the scenario's tolerance instead of exactly at rest.
        generator: draws a random start; None takes the plain one.
    """
    rough = explore(scenario, winding, nodes=nodes, tolerant=tolerant, generator=generator)
    return refine(scenario, rough, nodes=nodes, tolerant=tolerant)
