"""A program in stages: unknowns and constraints ordered in time, with derivatives step by step.

Stage k holds the state X[k], the length h of the step that led there, and the control U[k]. The
first step of a phase chooses its length as a third control; the later ones inherit it:

    (X[k+1], h[k+1]) = (step(X[k], U[k], h), h),   h = U[k, 2] in the first step of a phase, else h[k].

So every constraint but these ties the unknowns of one stage only, and the interior-point solver
fatrop (Vanroye et al. 2023) eliminates stage after stage, which takes a third of the time of a
general sparse factorisation. The derivatives of the step are written once and mapped over the
steps; they come cheap, because spherical Bessel functions differentiate into one another,

    j0' = -j1,   j1' = (j0 - 2 j2)/3,   j2' = (2 j1 - 3 j3)/5,

so that no power series needs to be differentiated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from optimal.direct.step_derivatives import step_functions

Indices = NDArray[np.int64]
Constraint = tuple[int, Any, list[bool]]

COLD: dict[str, Any] = {
    "structure_detection": "auto",
    "calc_lam_p": False,
    "fatrop.tol": 1e-5,
    "fatrop.print_level": 0,
    "fatrop.max_iter": 250,
    "print_time": False,
    "error_on_fail": False,
}
"""Settings of a solve from afar, on the coarse grid."""
WARM: dict[str, Any] = COLD | {
    "fatrop.tol": 1e-9,
    "fatrop.mu_init": 1e-5,
    "fatrop.bound_push": 1e-6,
    "fatrop.bound_frac": 1e-6,
    "fatrop.barrier_tol_factor": 100.0,
}
"""Settings of a solve from nearby: the start is not pushed off its bounds, the barrier is low from the beginning."""

RELAXED = 1e-8
"""How far the solver relaxes bounds, relative to their size or to 1."""
TIGHT, TOUCHING = 1.01, 0.99
"""What share of that bounds are moved inwards: more than all of it, or less where a flight begins or ends on its limit,
as at rest on the floor, and must stay inside; 1e-10 m is left over."""


@dataclass(frozen=True)
class Stages:
    """Where the unknowns of a program in stages stand.

    Attributes:
        steps: steps of each phase.
    """

    steps: tuple[int, ...]

    @cached_property
    def count(self) -> int:
        """N, the number of all steps."""
        return sum(self.steps)

    @cached_property
    def firsts(self) -> Indices:
        """The first step of each phase, shape (P,)."""
        return np.cumsum((0, *self.steps[:-1]))

    @cached_property
    def begins(self) -> Indices:
        """Where each stage begins, and the number of all unknowns, shape (N+2,)."""
        sizes = np.full(self.count + 1, 8)
        sizes[self.firsts] += 1  # the step length as a control
        sizes[0] -= 1  # no step leads to the first stage
        sizes[-1] -= 2  # nor is there a control at the last
        return np.append(0, np.cumsum(sizes))

    @cached_property
    def states(self) -> Indices:
        """Indices of the states, shape (N+1, 5)."""
        return self.begins[:-1, None] + np.arange(5)

    @cached_property
    def arrivals(self) -> Indices:
        """Indices of the lengths of the steps that led to the stages 1 to N, shape (N,)."""
        return self.begins[1:-1] + 5

    @cached_property
    def controls(self) -> Indices:
        """Indices of thrust and rate, shape (N, 2)."""
        heads = np.full(self.count, 6)
        heads[0] = 5
        return (self.begins[:-2] + heads)[:, None] + np.arange(2)

    @cached_property
    def lengths(self) -> Indices:
        """Indices of the lengths of the phases' steps, where they are chosen, shape (P,)."""
        return self.controls[self.firsts, 1] + 1

    @cached_property
    def departures(self) -> Indices:
        """Indices of the length of each step as it is flown, shape (N,)."""
        flown = np.append(0, self.arrivals[:-1])
        flown[self.firsts] = self.lengths
        return flown

    @property
    def arcs(self) -> Indices:
        """Indices of all that a step depends on, [x, z, vx, vz, theta, h, thrust, rate], shape (N, 8)."""
        return np.column_stack([self.states[:-1], self.departures, self.controls])

    @property
    def size(self) -> int:
        """The number of all unknowns."""
        return int(self.begins[-1])

    def rows(self, further: Sequence[tuple[int, list[bool]]]) -> tuple[Indices, Indices, list[bool]]:
        """Return the rows of the gaps (N, 6), those of further constraints, and whether each row is an equation.

        Args:
            further: further constraints in order of their stages: the stage, and of each row whether it is an equation.
        """
        equations: list[bool] = []
        gaps, rest, left = [], [], deque(further)
        for k in range(self.count + 1):
            if k < self.count:
                gaps.append(len(equations) + np.arange(6))
                equations += [True] * 6
            while left and left[0][0] == k:
                rest.append(len(equations) + np.arange(len(left[0][1])))
                equations += left.popleft()[1]
        return np.array(gaps), np.concatenate([*rest, np.zeros(0)]).astype(np.int64), equations

    def pack(self, lengths: Any, states: Any, controls: Any) -> Array:
        """Return the unknowns from lengths (P,), states (N+1, 5) and controls (N, 2)."""
        unknowns = np.zeros(self.begins[-1])
        unknowns[self.states], unknowns[self.controls] = states, controls
        unknowns[self.lengths], unknowns[self.arrivals] = lengths, np.repeat(lengths, self.steps)
        return unknowns


def solver(stages: Stages, problem: dict[str, Any], further: Sequence[Constraint], options: dict[str, Any]) -> Any:
    """Return the parametric solver of a program in stages.

    Args:
        stages: its phases and steps.
        problem: symbols "x" of all unknowns, placed as `stages` says, symbols "p" of the parameters,
            gravity first, and the objective "f", linear in the unknowns.
        further: constraints besides the steps in order of their stages: the stage, a column of expressions of
            its unknowns, and of each whether it is an equation.
        options: COLD or WARM.

    The constraints are, stage by stage, the gaps X[k+1] - step(X[k], U[k], h) and h[k+1] - h, then the further
    ones r:

        g(x) = A x - E F(S x) + R r(x),

    with F the step, mapped, S picking what it depends on, and A, E, R constant.
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
    known = {
        "nlp_jac_g": ca.Function("nlp_jac_g", [x, p], [ties @ x - place @ ca.vec(landed) + spread @ r, jacobian]),
        "nlp_hess_l": ca.Function("nlp_hess_l", [x, p, lam_f, lam_g], [gradient, hessian]),
    }
    program = {"x": x, "p": p, "f": local["objective"](x, p), "g": g}
    return ca.nlpsol("stages", "fatrop", program, {**options, "equality": equations, "cache": known})


def tightened(low: Array, high: Array, share: float = TIGHT) -> tuple[Array, Array]:
    """Return bounds moved inwards by what the solver relaxes them, so that a solution keeps the true ones.

    Equations and what is unbounded stay as they are.

    Args:
        low, high: the bounds.
        share: of the relaxation; less than 1 where the true bound itself must remain feasible.
    """
    room, least, most = high - low > 0, np.isfinite(low), np.isfinite(high)
    up = np.where(room & least, share * RELAXED * np.maximum(1, np.abs(np.where(least, low, 0.0))), 0.0)
    down = np.where(room & most, share * RELAXED * np.maximum(1, np.abs(np.where(most, high, 0.0))), 0.0)
    return low + up, high - down


def _selection(columns: Indices, width: int) -> Any:
    """Return the matrix that picks `columns` of `width`."""
    height = len(columns)
    return ca.DM.triplet(range(height), columns.tolist(), ca.DM.ones(height), height, width)


def _placed(blocks: Any, rows: Indices, columns: Indices, shape: tuple[int, int]) -> Any:
    """Return sparse blocks that stand side by side as one matrix, block k in rows[k] and columns[k] of it."""
    row, column = ca.horzsplit(blocks, blocks.shape[1] // len(rows))[0].sparsity().get_triplet()
    places = rows[:, row].ravel().tolist(), columns[:, column].ravel().tolist()
    pattern, order = ca.Sparsity.triplet(*shape, *places, False)
    return ca.MX(pattern, blocks.nz[order])


def _derivatives(problem: dict[str, Any], rest: Any) -> dict[str, Any]:
    """Return the objective and the extras with their derivatives as functions of unknowns and parameters."""
    x, p, f = problem["x"], problem["p"], problem["f"]
    lam_f, lam = ca.SX.sym("lam_f"), ca.SX.sym("lam", rest.shape[0])
    hessian, gradient = ca.hessian(ca.dot(lam, rest), x)
    return {
        "objective": ca.Function("objective", [x, p], [f]),
        "constraints": ca.Function("constraints", [x, p], [rest]),
        "jacobian": ca.Function("jacobian", [x, p], [rest, ca.jacobian(rest, x)]),
        "hessian": ca.Function("hessian", [x, p, lam_f, lam], [lam_f * ca.gradient(f, x), gradient, hessian]),
    }
