"""Free end time direct multiple shooting: the optimum T*, winding by winding.

A flight is a sequence of phases, one more than there are hoops; phase i has N_i steps of equal,
unknown length h_i, so that hoop i is crossed at a node:

    minimise  sum N_i h_i
    such that X[k+1] = step(X[k], U[k], h_i),  X[0] at rest at the start,
              X[N] at rest at the goal with theta = 2 pi winding,
              (p - c) . d = 0, |(p - c) . across| <= gap, v . d >= 0   at each hoop (c, d),
              thrust_min <= f <= thrust_max, |omega| <= rate_max, floor <= z <= ceiling.

The problem has local optima, one family for each number of turns, so `shoot` solves one winding
from one start and the front door tries them all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenario import Scenario
from optimal import transcription as tr
from optimal.trajectory import Trajectory

NODES = 100
"""Steps of a whole flight; with 400, T* falls by at most 3e-4 s on the named scenarios, 1.1e-5 s on the horizontals."""
LEAST_NODES = 25
"""Fewest steps of one phase."""
LONGEST = 20.0
"""Longest phase the solver considers [s]."""
WINDINGS = (0, 1, -1, 2, -2)
"""Whole turns of the tilt worth trying; a third never paid on the named scenarios."""
PLAIN_BEND = np.array([0.0, 0.0, 0.3])
"""Detour of the plain start in x [m], z [m], theta [rad]: a little tilt, because on vertical
displacements the mirror-symmetric flight is a saddle from which no gradient leads away."""


@dataclass(frozen=True)
class Shot:
    """What one solve from one start gave.

    Attributes:
        converged: whether Ipopt reached its tolerances.
        message: Ipopt's own word for how it ended.
        winding: whole turns made.
        trajectory: the flight at the last iterate (not to be trusted unless converged).
        costates: multipliers of the step equations, shape (N, 5).
        iterations: of Ipopt.
    """

    converged: bool
    message: str
    winding: int
    trajectory: Trajectory
    costates: Array
    iterations: int


def phase_steps(scenario: Scenario, nodes: int = NODES) -> tuple[int, ...]:
    """Return the number of steps of each phase, shared out by the lengths of the legs."""
    lengths = tr.legs(scenario)[1]
    return tuple(max(LEAST_NODES, round(nodes * length / lengths.sum())) for length in lengths)


@lru_cache(maxsize=32)
def program(steps: tuple[int, ...], limited: bool, tolerant: bool) -> Any:
    """Return the parametric solver of one shape.

    Args:
        steps: steps of each phase, length P.
        limited: whether there is a floor or a ceiling.
        tolerant: whether the flight may end anywhere within the tolerance.

    Unknowns in this order: h (P,), X (5, N+1) and U (2, N) by columns; parameters: gravity, hoops
    (4, P-1), target (6,); constraints: step gaps (5 N,), heights (2 N,) if limited, crossings
    (3 (P-1),), arrival (3,) if tolerant.
    """
    count, hoop_count = sum(steps), len(steps) - 1
    h = ca.MX.sym("h", len(steps))
    states, controls = ca.MX.sym("X", 5, count + 1), ca.MX.sym("U", 2, count)
    gravity, hoops, target = ca.MX.sym("g"), ca.MX.sym("hoops", 4, hoop_count), ca.MX.sym("target", 6)
    lengths = ca.horzcat(*(ca.repmat(h[i], 1, n) for i, n in enumerate(steps)))
    constraints = [tr.gaps(states, controls, lengths, gravity)]
    if limited:
        constraints.append(tr.heights(states, lengths))
    for i, node in enumerate(np.cumsum(steps)[:-1]):
        constraints.append(tr.crossing(states[:, int(node)], hoops[:, i]))
    if tolerant:
        constraints.append(tr.arrival(states[:, -1], target))
    problem = {
        "x": ca.vertcat(h, ca.vec(states), ca.vec(controls)),
        "p": ca.vertcat(gravity, ca.vec(hoops), target),
        "f": ca.dot(ca.DM(steps), h),
        "g": ca.vertcat(*constraints),
    }
    return ca.nlpsol("shooting", "ipopt", problem, {"expand": True, **tr.IPOPT})


def bounds(scenario: Scenario, steps: tuple[int, ...], winding: int, tolerant: bool) -> dict[str, Array]:
    """Return the bounds and parameters of `program` for one scenario and winding."""
    count, q = sum(steps), scenario.quadrotor
    low, high = tr.state_limits(scenario, count + 1)
    if not tolerant:
        low[:, -1] = high[:, -1] = scenario.goal_state + 2 * np.pi * winding * np.eye(5)[4]
    floor, ceiling = tr.height_limits(scenario)
    limited = 2 * count * tr.limited(scenario)
    arrival = 3 * tolerant
    crossing_low, crossing_high = tr.crossing_limits(scenario)
    return {
        "lbx": np.concatenate([np.full(len(steps), 1e-5), low.T.ravel(), np.tile(q.control_low, count)]),
        "ubx": np.concatenate([LONGEST / np.array(steps), high.T.ravel(), np.tile(q.control_high, count)]),
        "lbg": np.concatenate([np.zeros(5 * count), np.full(limited, floor), crossing_low, np.zeros(arrival)]),
        "ubg": np.concatenate([np.zeros(5 * count), np.full(limited, ceiling), crossing_high, np.ones(arrival)]),
        "p": np.concatenate(
            [[q.gravity], tr.hoop_parameters(scenario).T.ravel(), tr.arrival_target(scenario, winding)]
        ),
    }


def first_guess(
    scenario: Scenario, steps: tuple[int, ...], winding: int, generator: np.random.Generator | None = None
) -> Array:
    """Return a start for `program`: the plain one, or a bent and stretched one drawn from `generator`."""
    q, (_, lengths) = scenario.quadrotor, tr.legs(scenario)
    duration, bend = 2 * np.sqrt(lengths.sum() / (q.thrust_max - q.gravity)) + 0.3, PLAIN_BEND
    if generator is not None:
        duration *= generator.uniform(0.7, 1.8)
        bend = generator.normal(0.0, [0.3, 0.3, 1.0])
    h = duration * lengths / lengths.sum() / np.array(steps)
    share = np.append(0.0, np.cumsum(np.repeat(h, steps))) / duration
    states = tr.guess_states(scenario, share, duration, winding, bend)
    controls = np.tile([q.gravity, np.clip(2 * np.pi * winding / duration, -q.rate_max, q.rate_max)], (sum(steps), 1))
    return np.concatenate([h, states.T.ravel(), controls.ravel()])


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
    steps = phase_steps(scenario, nodes)
    solver = program(steps, tr.limited(scenario), tolerant)
    guess = first_guess(scenario, steps, winding, generator)
    result = solver(x0=guess, **bounds(scenario, steps, winding, tolerant))
    stats, values = solver.stats(), np.array(result["x"]).ravel()
    count, head = sum(steps), len(steps)
    h = np.repeat(values[:head], steps)
    trajectory = Trajectory(
        breakpoints=np.append(0.0, np.cumsum(h)),
        states=values[head : head + 5 * (count + 1)].reshape(count + 1, 5),
        controls=values[head + 5 * (count + 1) :].reshape(count, 2),
        quadrotor=scenario.quadrotor,
    )
    return Shot(
        converged=stats["return_status"] in tr.SUCCESS,
        message=stats["return_status"],
        winding=winding,
        trajectory=trajectory,
        costates=np.array(result["lam_g"]).ravel()[: 5 * count].reshape(count, 5),
        iterations=stats["iter_count"],
    )
