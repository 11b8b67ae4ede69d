"""The solver of a program in stages: fatrop, with exact derivatives mapped over the steps.

The interior-point solver fatrop (Vanroye et al. 2023) eliminates one stage after the other. That takes a third of the
time of a general sparse factorisation. The derivatives of the step are written once (`optimal.direct.step_derivatives`)
and mapped over all steps; those of the further constraints come from automatic differentiation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from optimal.direct.stages import Indices, Stages
from optimal.direct.step_derivatives import step_functions

Constraint = tuple[int, Any, list[bool]]
"""Stage, column of expressions, and whether each row is an equation."""

COLD: dict[str, Any] = {
    "structure_detection": "auto",
    "calc_lam_p": False,
    "fatrop.tol": 1e-5,
    "fatrop.print_level": 0,
    "fatrop.max_iter": 250,
    "print_time": False,
    "error_on_fail": False,
}
"""Settings of a cold start, on the coarse grid."""
WARM: dict[str, Any] = COLD | {
    "fatrop.tol": 1e-9,
    "fatrop.mu_init": 1e-5,
    "fatrop.bound_push": 1e-6,
    "fatrop.bound_frac": 1e-6,
    "fatrop.barrier_tol_factor": 100.0,
}
"""Settings of a warm start: the guess is not pushed off its bounds, and the barrier is low from the beginning."""

LARGEST_DERIVATIVE = 1e10
"""Largest absolute entry of a Jacobian or Hessian; larger ones are clipped. While the factorisation finds a Hessian
indefinite, the solver adds a growing multiple of the identity to it, without a limit of iterations. It has been seen
never to return where entries reached 1e14."""
RELAXATION = 1e-8
"""The solver relaxes each bound by this, relative to the bound or to 1, whichever is larger."""
TIGHTENING_SHARE, TOUCHING_SHARE = 1.01, 0.99
"""Shares of the relaxation by which bounds are moved inwards: more than all of it, or less where a flight begins or
ends on its limit (at rest on the floor) and must stay feasible; there 1e-10 m is left over."""


def solver(stages: Stages, problem: dict[str, Any], further: Sequence[Constraint], options: dict[str, Any]) -> Any:
    """Return the parametric solver of a program in stages.

    Args:
        stages: its phases and steps.
        problem: symbols "x" of all unknowns, placed by `stages`, symbols "p" of the parameters, gravity first, and
            the objective "f", linear in the unknowns.
        further: constraints besides the dynamics, ordered by stage: the stage, a column of expressions of its
            unknowns, and whether each row is an equation.
        options: settings of the solver, COLD or WARM.

    The constraints are, stage by stage, the dynamics X[k+1] - step(X[k], U[k], h) and h[k+1] - h, then the further
    ones r:

        g(x) = A x - E F(S x) + R r(x),

    with F the mapped step, S the selection of what it depends on, and constant A, E, R.
    """
    count, unknowns = stages.count, problem["x"].shape[0]
    gap_rows, rest_rows, equations = stages.rows([(k, which) for k, _, which in further])
    rows, rest = len(equations), ca.vertcat(*(expression for _, expression, _ in further), ca.SX(0, 1))
    after, departures = np.column_stack([stages.states[1:], stages.arrivals]), stages.departures
    pick = _selection(stages.arcs.ravel(), unknowns)
    place, spread = _selection(gap_rows[:, :5].ravel(), rows).T, _selection(rest_rows, rows).T
    ties = _selection(gap_rows.ravel(), rows).T @ _selection(after.ravel(), unknowns)
    ties -= _selection(gap_rows[:, 5], rows).T @ _selection(departures, unknowns)
    local = _derivatives(problem, rest)

    x, p = ca.MX.sym("x", unknowns), ca.MX.sym("p", problem["p"].shape[0])
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    step, step_jacobian, step_hessian = (f.map(count) for f in step_functions())
    arcs, gravity = ca.reshape(pick @ x, 8, count), ca.repmat(p[0], 1, count)
    r, r_jacobian = local["jacobian"](x, p)
    f_gradient, r_gradient, r_hessian = local["hessian"](x, p, lam_f, spread.T @ lam_g)
    landed, slopes = step_jacobian(arcs, gravity)
    gradient, curvature = step_hessian(arcs, gravity, ca.reshape(-place.T @ lam_g, 5, count))
    g = ties @ x - place @ ca.vec(step(arcs, gravity)) + spread @ local["constraints"](x, p)
    jacobian = ties - _placed(slopes, gap_rows, stages.arcs, (rows, unknowns))
    hessian = _placed(curvature, stages.arcs, stages.arcs, (unknowns, unknowns))
    if further:
        jacobian, hessian = jacobian + spread @ r_jacobian, hessian + r_hessian
    gradient = ties.T @ lam_g + pick.T @ ca.vec(gradient) + f_gradient + r_gradient
    value = ties @ x - place @ ca.vec(landed) + spread @ r
    known = {
        "nlp_jac_g": ca.Function("nlp_jac_g", [x, p], [value, _clipped(jacobian)]),
        "nlp_hess_l": ca.Function("nlp_hess_l", [x, p, lam_f, lam_g], [gradient, _clipped(hessian)]),
    }
    program = {"x": x, "p": p, "f": local["objective"](x, p), "g": g}
    return ca.nlpsol("stages", "fatrop", program, {**options, "equality": equations, "cache": known})


def tightened(low: Array, high: Array, share: float = TIGHTENING_SHARE) -> tuple[Array, Array]:
    """Return bounds moved inwards by the relaxation of the solver, so that a solution keeps the true bounds.

    Equations and infinite bounds stay unchanged, and half of the room between two bounds is left.

    Args:
        low, high: the bounds.
        share: of the relaxation; less than 1 where the true bound itself must remain feasible.
    """
    room, least, most = high - low, np.isfinite(low), np.isfinite(high)
    up, down = (
        np.where((room > 0) & finite, np.minimum(share * RELAXATION * np.maximum(1, np.abs(bound)), room / 4), 0.0)
        for finite, bound in ((least, np.where(least, low, 0.0)), (most, np.where(most, high, 0.0)))
    )
    return low + up, high - down


def _clipped(matrix: Any) -> Any:
    """Return a sparse matrix with entries clipped to +-LARGEST_DERIVATIVE; nan becomes one of the ends."""
    entries = ca.fmin(ca.fmax(matrix.nz[:], -LARGEST_DERIVATIVE), LARGEST_DERIVATIVE)
    return ca.MX(matrix.sparsity(), entries)


def _selection(columns: Indices, width: int) -> Any:
    """Return the matrix that selects `columns` of `width`."""
    height = len(columns)
    return ca.DM.triplet(range(height), columns.tolist(), ca.DM.ones(height), height, width)


def _placed(blocks: Any, rows: Indices, columns: Indices, shape: tuple[int, int]) -> Any:
    """Return one sparse matrix from blocks side by side, block k at rows[k] and columns[k] of it."""
    row, column = ca.horzsplit(blocks, blocks.shape[1] // len(rows))[0].sparsity().get_triplet()
    places = rows[:, row].ravel().tolist(), columns[:, column].ravel().tolist()
    pattern, order = ca.Sparsity.triplet(*shape, *places, False)
    return ca.MX(pattern, blocks.nz[order])


def _derivatives(problem: dict[str, Any], rest: Any) -> dict[str, Any]:
    """Return objective and further constraints with derivatives as functions of unknowns and parameters."""
    x, p, f = problem["x"], problem["p"], problem["f"]
    lam_f, lam = ca.SX.sym("lam_f"), ca.SX.sym("lam", rest.shape[0])
    hessian, gradient = ca.hessian(ca.dot(lam, rest), x)
    return {
        "objective": ca.Function("objective", [x, p], [f]),
        "constraints": ca.Function("constraints", [x, p], [rest]),
        "jacobian": ca.Function("jacobian", [x, p], [rest, ca.jacobian(rest, x)]),
        "hessian": ca.Function("hessian", [x, p, lam_f, lam], [lam_f * ca.gradient(f, x), gradient, hessian]),
    }
