"""TODO optimal/direct/program.py."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct import transcription as tr
from optimal.direct.stages import COLD, TOUCHING, WARM, Indices, Stages, solver, tightened

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
        return np.array(scenario.heights)[:, None]
    if kind == "crossing":
        return np.array(tr.crossing_limits(scenario))[:, 3 * hoop : 3 * hoop + 3]
    if kind == "rims":
        rows = len(EQUATIONS[kind])
        return np.array([np.full(rows, (scenario.quadrotor.radius + clearance) ** 2), np.full(rows, np.inf)])
    return np.array([np.zeros(3), np.ones(3)])
