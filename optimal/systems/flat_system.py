"""Differential flatness, section II-A: states and inputs as functions of an output and its derivatives.

A system  x' = f(x, u)  (1)  is flat with the output y if

    x = Phi(y, y', ..., y^(beta-1)),      u = Psi(y, y', ..., y^(beta)).                      (2)

Any sufficiently smooth curve y(t) is then a motion of the system, and no integration is needed. The list
y, y', ..., y^(beta) is called the jet.

Each system is a subclass in its own file. It implements f, the output, and the parts of Phi and Psi that are not plain
time derivatives. CasADi provides the rest: `time_derivative` differentiates an expression along a jet, and `flat_jet`
computes the jet of a state and a held input by Lie derivatives along f.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array
from optimal.paths.chain_rule import composed

Symbol = Any
"""A CasADi expression."""
Jet = Sequence[Symbol]
"""The flat output and its time derivatives, each a column with one entry for each output."""


class FlatSystem(ABC):
    """A differentially flat system with limits on its states and inputs.

    Attributes:
        outputs, states, inputs: names, each ending with its unit as in exported files (`x_m`).
        order: beta, the highest derivative of the outputs on which the inputs depend.
        angles: indices of states that are angles, which are unwrapped along a motion.
    """

    outputs: ClassVar[tuple[str, ...]]
    states: ClassVar[tuple[str, ...]]
    inputs: ClassVar[tuple[str, ...]]
    order: ClassVar[int]
    angles: ClassVar[tuple[int, ...]] = ()

    @abstractmethod
    def dynamics(self, state: Symbol, control: Symbol) -> Symbol:
        """Return f(x, u) of eq. (1)."""

    @abstractmethod
    def output(self, state: Symbol) -> Symbol:
        """Return the flat output y of a state."""

    @abstractmethod
    def inverse(self, jet: Jet) -> tuple[Symbol, Symbol]:
        """Return the state and the input of a jet up to order beta: Phi and Psi of eq. (2)."""

    @abstractmethod
    def limits(self) -> tuple[Array, Array, Array, Array]:
        """Return least states, greatest states, least inputs and greatest inputs; infinite without a limit."""

    def lift(self) -> Lift:
        """Return the lifted unknowns of a program. By default there are none, and limits are imposed on `inverse`."""
        return Lift(self)

    @cached_property
    def bounds(self) -> tuple[NDArray[np.intp], Array, Array, Array]:
        """The limited entries of (state, input): indices, scales, and least and greatest values divided by scale."""
        state_low, state_high, input_low, input_high = self.limits()
        low, high = np.concatenate([state_low, input_low]), np.concatenate([state_high, input_high])
        which = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
        ends = np.abs([low[which], high[which]])
        scale = np.where(np.isfinite(ends), ends, 0.0).max(axis=0)
        return which, scale, low[which] / scale, high[which] / scale

    def limited_values(self, jet: Sequence[ArrayLike]) -> Array:
        """Return the limited quantities of numeric jets, divided by their scales, shape (..., limits)."""
        which, scale, _, _ = self.bounds
        return np.concatenate(self.state_and_input(jet), axis=-1)[..., which] / scale

    @cached_property
    def symbolic_inverse(self) -> Any:
        """`inverse` as a CasADi function of the jet's beta + 1 columns."""
        jet = [ca.SX.sym(f"y{k}", len(self.outputs)) for k in range(self.order + 1)]
        return ca.Function("inverse", jet, list(self.inverse(jet)))

    def state_and_input(self, jet: Sequence[ArrayLike]) -> tuple[Array, Array]:
        """Return the states (..., n) and inputs (..., m) of numeric jets, beta + 1 arrays of shape (..., outputs)."""
        columns = [np.asarray(y, dtype=np.float64) for y in jet]
        shape = columns[0].shape[:-1]
        parts = self.symbolic_inverse(*(y.reshape(-1, y.shape[-1]).T for y in columns))
        state, control = (np.array(part).T.reshape(*shape, -1) for part in parts)
        return state, control

    def flat_jet(self, state: ArrayLike, control: ArrayLike) -> list[Array]:
        """Return the jet up to order beta of a state (n,) under a held input (m,)."""
        x, u = ca.SX.sym("x", len(self.states)), ca.SX.sym("u", len(self.inputs))
        jet = [self.output(x)]
        for _ in range(self.order):
            jet.append(ca.jtimes(jet[-1], x, self.dynamics(x, u)))
        values = ca.Function("jet", [x, u], jet)(np.asarray(state), np.asarray(control))
        return [np.array(y).ravel() for y in values]

    def derivative(self, state: ArrayLike, control: ArrayLike) -> Array:
        """Return f(x, u) of a numeric state (n,) and input (m,), shape (n,), for an integrator."""
        return np.array(self._dynamics(np.asarray(state), np.asarray(control))).ravel()

    @cached_property
    def _dynamics(self) -> Any:
        x, u = ca.SX.sym("x", len(self.states)), ca.SX.sym("u", len(self.inputs))
        return ca.Function("dynamics", [x, u], [self.dynamics(x, u)])


class Lift:
    """Additional unknowns of a program at each check, coupled to the jet, with which limits become simple bounds.

    A limit of an input is often a strongly nonlinear function of the jet (a square root, an arc tangent, a quotient),
    and a simple function of a few states. This base class has no additional unknowns.

    Attributes:
        names: names of the unknowns.
        low, high: their least and greatest values.
        rest: their values when the system is at rest; NaN for any value.
        guess: their initial guess.
        limited: the unknown that each of the first limited quantities is, in the order of `FlatSystem.bounds`. Their
            limits are bounds of these unknowns.
    """

    names: tuple[str, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    rest: tuple[float, ...] = ()
    guess: tuple[float, ...] = ()
    limited: tuple[int, ...] = ()

    def __init__(self, system: FlatSystem) -> None:
        self.system = system

    def coupling(self, jet: Jet, lifted: Symbol) -> Symbol:  # noqa: ARG002
        """Return the residuals that vanish if the unknowns agree with the jet, which is given up to order beta - 1."""
        return ca.SX(0, 1)

    def limited_quantities(self, jet: Jet, lifted: Symbol) -> Symbol:  # noqa: ARG002
        """Return the limited quantities that are not unknowns, in the order and the scale of `FlatSystem.bounds`."""
        which, scale, _, _ = self.system.bounds
        return ca.vertcat(*self.system.symbolic_inverse(*jet))[which.tolist()] / scale

    def values(self, jet: Sequence[Array]) -> Array:
        """Return the unknowns along a motion, from its numeric jets at n increasing instants, shape (n, unknowns)."""
        return np.zeros((len(jet[0]), 0))

    def turning_time(self, before: Symbol, after: Symbol) -> Symbol:  # noqa: ARG002
        """Return the least times [s] in which the unknowns change between two neighbouring checks, of either sign."""
        return ca.SX(0, 1)


def time_derivative(expression: Symbol, jet: Jet) -> Symbol:
    """Return d/dt of an expression of a jet, sum_k (d expression / d y^(k)) y^(k+1).

    The expression must not depend on the last order of the jet.
    """
    return sum((ca.jtimes(expression, y, after) for y, after in pairwise(jet)), ca.SX(0))


def along_path(path: Sequence[Any], squared_speed: Sequence[Any]) -> list[Any]:
    """Return the jet of a path y(s) travelled with ds/dt = sqrt(b(s)), eqs. (6) and (9).

    Args:
        path: y and its derivatives with respect to s, up to order beta.
        squared_speed: b and its derivatives with respect to s, up to order beta - 1: symbols, or arrays that
            broadcast against those of the path.

    Returns:
        y and its derivatives with respect to time, up to order beta.

    The misprints of eq. (6) are corrected: (ds/dt)^2 = b, and d2s/dt2 = b'/2. Higher derivatives are
    d^i s/dt^i = 1/2 d^(i-2) b'/dt^(i-2).
    """
    motion = [squared_speed[0] ** 0.5]
    for i in range(2, len(path)):
        motion.append(composed(squared_speed[1:], motion, i - 2) / 2)
    return [composed(path, motion, n) for n in range(len(path))]
