"""The program of K environment steps: how small could the tolerance at the goal be made?

For a fixed number of steps K everything is as the environment has it - constant control over dt,
a round tolerance at the goal, hoops crossed anywhere inside a step:

    minimise  m
    such that |p - goal|^2 <= m position^2,  |v|^2 <= m speed^2,  (theta - 2 pi w)^2 <= m angle^2,
              X[k+1] = step(X[k], U[k], dt),  limits and heights,
              hoop i crossed inside step j_i, within its gap, in its direction.

K steps are enough when m <= 1. Where step j crosses the line of a hoop, and how far aside, follows
from its own unknowns by one step of Newton's method from the chord, exact to a micrometre. So every
constraint belongs to one stage and `optimal.direct.stages` serves here as it does for free step lengths; m
stands at the last stage.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct import transcription as tr
from optimal.direct.stages import WARM, Stages, solver, tightened
from optimal.flights.trajectory import Flight

OPTIONS = WARM | {
    "fatrop.tol": 1e-7,
    "fatrop.mu_init": 1e-3,
    "fatrop.bound_push": 1e-3,
    "fatrop.bound_frac": 1e-3,
    "fatrop.max_iter": 64,
}
"""Settings of the solver: it starts from a flight that takes about as long but stops exactly at the goal. What leads to
a flight converges within 60 iterations. Later, on what has no solution, Fatrop's restoration has been seen never to
return; the fewer iterations, the rarer."""
HOOP_MARGIN = 1e-5
"""How far inside a gap a planned crossing stays [m]: float32 actions move the path by less."""
RIM_MARGINS = (1e-3, 5e-3)
"""How far beyond its radius the body keeps from the rims at the points looked at [m], one tried after the other:
between points 5 cm apart a body of radius 0.1 m can dip in by 3 mm, but most flights keep off further by themselves."""
LARGEST = 1e6
"""Largest m considered."""


class StepShape(NamedTuple):
    """What shares a program: steps, whether heights are limited, crossing steps, whether rims count."""

    steps: int
    limited: bool
    crossings: tuple[int, ...] = ()
    rims: bool = False


class StepFlight(NamedTuple):
    """What a solve gave: m (inf where it failed), controls (K, 2), and where in their steps hoops are crossed (H,)."""

    m: float
    controls: Array
    shares: Array


def constraints(shape: StepShape) -> Iterator[tuple[int, str, int]]:
    """Yield the constraints besides the steps, ordered by stage, as (stage, kind, hoop)."""
    for k in range(shape.steps + 1):
        if shape.limited and k < shape.steps:
            yield k, "rise", 0
        if shape.limited and k > 0:
            yield k, "fall", 0
        for i, j in enumerate(shape.crossings):
            if k == j:
                yield k, "crossing", i
            if shape.rims and abs(k - j) <= RIM_REACH and k < shape.steps:
                yield k, "rims", i
    yield shape.steps, "arrival", 0


RIM_REACH = 8
"""Steps before and after the crossing in which the body is kept clear of the rims."""
ROWS = {"rise": 1, "fall": 1, "crossing": 4, "rims": 2 * tr.RIM_POINTS, "arrival": 3}
"""The kinds of constraints, all of them inequalities, and their numbers of rows."""


@lru_cache(maxsize=24)  # of 5 to 8 MB each; joblib replaces workers that have grown by 300 MB, which takes seconds
def program(shape: StepShape) -> Any:
    """Return the parametric solver of one shape.

    Unknowns are placed as `Stages` says, m behind them; parameters: gravity, hoops (4, H), target (6,), rims (4, H).
    """
    stages, hoop_count = Stages((shape.steps,)), len(shape.crossings)
    x, gravity, target = ca.SX.sym("x", stages.size + 1), ca.SX.sym("g"), ca.SX.sym("target", 6)
    hoops, rims = ca.SX.sym("hoops", 4, hoop_count), ca.SX.sym("rims", 4, hoop_count)

    def expression(k: int, kind: str, i: int) -> Any:
        state = x[stages.states[k].tolist()]
        if kind == "rise":
            return state[1] + state[3] * x[int(stages.departures[k])] / 3
        if kind == "fall":
            return state[1] - state[3] * x[int(stages.arrivals[k - 1])] / 3
        if kind == "arrival":
            return tr.arrival(state, target) - x[stages.size]
        arc = x[stages.arcs[k].tolist()]
        return inside(arc, gravity, hoops[:, i]) if kind == "crossing" else tr.rim_distances(arc, gravity, rims[:, i])

    further = [(k, expression(k, kind, i), [False] * ROWS[kind]) for k, kind, i in constraints(shape)]
    parameters = ca.vertcat(gravity, ca.vec(hoops), target, ca.vec(rims))
    return solver(stages, {"x": x, "p": parameters, "f": x[stages.size]}, further, OPTIONS)


def inside(arc: Any, gravity: Any, hoop: Any) -> Any:
    """Return an arc's place along a hoop before and after, and aside and speed along when crossing, for an arc (8,)."""
    before = tr.crossing(arc[:5], hoop)
    after = tr.crossing(tr.step_function()(arc[:5], arc[6:], arc[5], gravity), hoop)
    chord = -arc[5] * before[0] / (after[0] - before[0])
    near = tr.crossing(tr.step_function()(arc[:5], arc[6:], chord, gravity), hoop)
    time = chord - near[0] / near[2]
    there = tr.crossing(tr.step_function()(arc[:5], arc[6:], time, gravity), hoop)
    return ca.vertcat(before[0], after[0], there[1:])


def bounds(target: Scenario, shape: StepShape, winding: int, clearance: float = 0.0) -> dict[str, Array]:
    """Return the bounds and parameters of `program` for one scenario and winding, so far clear of the rims [m]."""
    stages, quadrotor, dt = Stages((shape.steps,)), target.quadrotor, np.array([target.dt])
    low, high = tr.state_limits(target, shape.steps + 1)
    weakest, strongest = tightened(quadrotor.control_low, quadrotor.control_high)
    kept = [_limits(target, kind, i, clearance) for _, kind, i in constraints(shape)]
    rows = stages.rows([(k, [False] * ROWS[kind]) for k, kind, _ in constraints(shape)])[1]
    limits = np.zeros((2, 6 * shape.steps + len(rows)))
    limits[:, rows] = np.concatenate(kept, axis=1)
    hoops, rims = tr.hoop_parameters(target).T.ravel(), tr.rim_parameters(target).T.ravel()
    return {
        "lbx": np.append(stages.pack(dt, low.T, weakest), 0.0),
        "ubx": np.append(stages.pack(dt, high.T, strongest), LARGEST),
        "lbg": limits[0],
        "ubg": limits[1],
        "p": np.concatenate([[quadrotor.gravity], hoops, tr.arrival_target(target, winding), rims]),
    }


def _limits(target: Scenario, kind: str, hoop: int, clearance: float) -> Array:
    """Return least and greatest values of one of the `constraints`, shape (2, rows)."""
    rows = ROWS[kind]
    if kind in ("rise", "fall"):
        return np.array(target.heights)[:, None]
    if kind == "crossing":
        gap = target.hoops[hoop].half_gap(target.quadrotor.radius) - HOOP_MARGIN
        return np.array([[-np.inf, 0.0, -gap, 0.0], [0.0, np.inf, gap, np.inf]])
    if kind == "rims":
        return np.array([np.full(rows, (target.quadrotor.radius + clearance) ** 2), np.full(rows, np.inf)])
    return np.array([np.full(rows, -np.inf), np.zeros(rows)])


def first_guess(target: Scenario, flight: Flight, count: int) -> Array:
    """Return a free-time flight, sampled at `count` even steps and flown at dt, as a start for `program`."""
    time = np.linspace(0.0, flight.duration, count + 1)
    states, thrust = tr.resampled(flight, time)
    controls = np.stack([thrust, np.diff(states[:, 4]) / time[1]], axis=-1)
    return np.append(Stages((count,)).pack(np.array([target.dt]), states, controls), 1.0)


def fly(target: Scenario, shape: StepShape, winding: int, guess: Array, clearance: float = 0.0) -> StepFlight:
    """Solve `program` for one scenario and winding from a start, so far clear of the rims [m]."""
    run, stages = program(shape), Stages((shape.steps,))
    result = run(x0=guess, **bounds(target, shape, winding, clearance))
    values = np.array(result["x"]).ravel()
    controls, shares = values[stages.controls], np.zeros(len(shape.crossings))
    for i, j in enumerate(shape.crossings):
        ends = (values[stages.states[k]][:2] - target.hoops[i].centre for k in (j, j + 1))
        before, after = (float(end @ target.hoops[i].direction) for end in ends)
        shares[i] = -before / max(after - before, 1e-12)
    return StepFlight(float(values[-1]) if run.stats()["success"] else np.inf, controls, shares)
