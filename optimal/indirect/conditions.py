"""The boundary-value problem of one switching structure.

Unknowns of n arcs: their n durations, q0 and q1, where q(t) = q0 + q1 t is the velocity costate. There are n + 4
equations: five end conditions, and the switching conditions at the n - 1 junctions of arcs. With
e = (sin theta, cos theta), e' = (cos theta, -sin theta) and p the costate of the tilt, the switching conditions are

    q . e = 0 where the thrust switches,    p = 0 where the rate switches,    q . e' = 0 where a singular arc begins.

All arcs are closed forms, so the equations are algebraic. CasADi differentiates them exactly.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from optimal.direct.transcription import step_function
from optimal.indirect.arcs import ArcControl
from optimal.indirect.extremal import singular_step


@lru_cache(maxsize=256)
def conditions(structure: tuple[ArcControl, ...], gravity: float) -> Any:
    """Return the equations of a structure of n arcs, as a CasADi function.

    Arguments of the function: the unknowns (n + 4,), and the end state minus the start state (5,).
    Results: the residuals (n + 4,), their Jacobian (n + 4, n + 4), and the states at all junctions (5, n + 1).
    """
    count = len(structure)
    unknowns, end = ca.SX.sym("unknowns", count + 4), ca.SX.sym("end", 5)
    q, q1, states, zero = unknowns[count : count + 2], unknowns[count + 2 :], [ca.SX.zeros(5)], []
    for i, (thrust, rate) in enumerate(structure):
        if i:
            zero += switching(structure[i - 1], structure[i], states[-1], q, q1, gravity)
        h = unknowns[i]
        if rate is None:
            split = (ca.vertsplit(states[-1]), thrust, ca.vertsplit(q), ca.vertsplit(q1))
            states.append(ca.vertcat(*singular_step(*split, h, gravity, ca)))
        else:
            states.append(step_function()(states[-1], ca.vertcat(thrust, rate), h, gravity))
        q += q1 * h
    residuals = ca.vertcat(states[-1] - end, *zero)
    results = [residuals, ca.jacobian(residuals, unknowns), ca.horzcat(*states)]
    return ca.Function("conditions", [unknowns, end], results)


def switching(before: ArcControl, after: ArcControl, state: Any, q: Any, q1: Any, gravity: float) -> list[Any]:
    """Return the residuals of the switching conditions at the junction of two arcs.

    p = 0 is written by H = 1, see `optimal.indirect.pontryagin`. q . e and q . e' are divided by |q|.
    """
    sin, cos, norm = ca.sin(state[4]), ca.cos(state[4]), ca.norm_2(q)
    along, across, zero = q[0] * sin + q[1] * cos, q[0] * cos - q[1] * sin, []
    if before[0] != after[0]:
        zero.append(along / norm)
    if before[1] != after[1] and before[1] is not None:
        zero.append(1 + ca.dot(q1, state[2:4]) - before[0] * along + q[1] * gravity)
    if before[1] != after[1] and after[1] is None:
        zero.append(across / norm)
    return zero


def equations(unknowns: Array, system: Any, end: Array) -> tuple[Array, Array]:
    """Return residuals and Jacobian of `conditions` as NumPy arrays."""
    residuals, jacobian, _ = system(unknowns, end)
    return np.array(residuals).ravel(), np.array(jacobian)
