"""Differential flatness, section II-A: states and inputs as functions of an output and its derivatives.

A system  x' = f(x, u)  (1)  is flat with the output y when

    x = Phi(y, y', ..., y^(beta-1)),      u = Psi(y, y', ..., y^(beta)),                      (2)

so that any smooth enough curve y(t) is a motion of the system, and nothing has to be integrated.
The list y, y', ..., y^(beta) is called the jet here.

A system is one file: a subclass that writes f and, as far as it is not a plain time derivative, Phi
and Psi. CasADi supplies the rest: `time_derivative` differentiates along a jet, `flat_jet` goes
the other way, from a state and a held input to the jet, by Lie derivatives along f.
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
"""The flat output and its time derivatives, each a column of one entry for each output."""


class FlatSystem(ABC):
    """A differentially flat system with limits on its states and inputs.

    Attributes:
        outputs, states, inputs: names, each ending with its unit as in exported files (`x_m`).
        order: beta, the highest derivative of the outputs that the inputs depend on.
        angles: indices of states that are angles, to be followed beyond half a turn.
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
        """Return state and input of a jet up to order beta, Phi and Psi of eq. (2)."""

    @abstractmethod
    def limits(self) -> tuple[Array, Array, Array, Array]:
        """Return least and greatest states, least and greatest inputs; infinite where there is no limit."""

    def lift(self) -> Lift:
        """Return what stands beside the jet in a program; by default nothing, and limits are read off `inverse`."""
        return Lift(self)

    @cached_property
    def bounds(self) -> tuple[NDArray[np.intp], Array, Array, Array]:
        """The limited entries of (state, input): indices, scales, and least and greatest values over scale."""
        state_low, state_high, input_low, input_high = self.limits()
        low, high = np.concatenate([state_low, input_low]), np.concatenate([state_high, input_high])
        which = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
        ends = np.abs([low[which], high[which]])
        scale = np.where(np.isfinite(ends), ends, 0.0).max(axis=0)
        return which, scale, low[which] / scale, high[which] / scale

    def limited_values(self, jet: Sequence[ArrayLike]) -> Array:
        """Return the limited quantities of numeric jets over their scales, shape (..., limits)."""
        which, scale, _, _ = self.bounds
        return np.concatenate(self.state_and_input(jet), axis=-1)[..., which] / scale

    @cached_property
    def symbolic_inverse(self) -> Any:
        """`inverse` as a CasADi function of the jet's beta + 1 columns."""
        jet = [ca.SX.sym(f"y{k}", len(self.outputs)) for k in range(self.order + 1)]
        return ca.Function("inverse", jet, list(self.inverse(jet)))

    def state_and_input(self, jet: Sequence[ArrayLike]) -> tuple[Array, Array]:
        """Return the states (..., n) and inputs (..., m) of numeric jets: beta + 1 arrays of shape (..., outputs)."""
        columns = [np.asarray(y, dtype=np.float64) for y in jet]
        shape = columns[0].shape[:-1]
        found = self.symbolic_inverse(*(y.reshape(-1, y.shape[-1]).T for y in columns))
        state, control = (np.array(part).T.reshape(*shape, -1) for part in found)
        return state, control

    def flat_jet(self, state: ArrayLike, control: ArrayLike) -> list[Array]:
        """Return the jet, up to order beta, of a state (n,) while an input (m,) is held."""
        x, u = ca.SX.sym("x", len(self.states)), ca.SX.sym("u", len(self.inputs))
        jet = [self.output(x)]
        for _ in range(self.order):
            jet.append(ca.jtimes(jet[-1], x, self.dynamics(x, u)))
        found = ca.Function("jet", [x, u], jet)(np.asarray(state), np.asarray(control))
        return [np.array(y).ravel() for y in found]

    def derivative(self, state: ArrayLike, control: ArrayLike) -> Array:
        """Return f(x, u) of a numeric state (n,) and input (m,), shape (n,), for an integrator."""
        return np.array(self._dynamics(np.asarray(state), np.asarray(control))).ravel()

    @cached_property
    def _dynamics(self) -> Any:
        x, u = ca.SX.sym("x", len(self.states)), ca.SX.sym("u", len(self.inputs))
        return ca.Function("dynamics", [x, u], [self.dynamics(x, u)])


class Lift:
    """Unknowns beside the jet at each check of a program, tied to it, so that limits become boxes.

    A limit on an input is often a hard function of the jet (a square root, an arc tangent, a
    quotient) and easy in terms of a few of the states. This base lifts nothing.

    Attributes:
        names: what the unknowns are.
        low, high: their least and greatest values.
        rest: their values where the system rests; NaN where they may be anything.
        guess: where to begin.
    """

    names: tuple[str, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    rest: tuple[float, ...] = ()
    guess: tuple[float, ...] = ()

    def __init__(self, system: FlatSystem) -> None:
        self.system = system

    def coupling(self, jet: Jet, lifted: Symbol) -> Symbol:  # noqa: ARG002
        """Return what vanishes when the unknowns belong to the jet, which is given up to order beta - 1."""
        return ca.SX(0, 1)

    def limited_quantities(self, jet: Jet, lifted: Symbol) -> Symbol:  # noqa: ARG002
        """Return the system's limited quantities, in the order and the scale of `FlatSystem.bounds`."""
        which, scale, _, _ = self.system.bounds
        return ca.vertcat(*self.system.symbolic_inverse(*jet))[which.tolist()] / scale

    def least_turning_time(self, before: Symbol, after: Symbol) -> Symbol:  # noqa: ARG002
        """Return the least times [s] in which the unknowns can change from one check's to the next's."""
        return ca.SX(0, 1)


def time_derivative(expression: Symbol, jet: Jet) -> Symbol:
    """Return d/dt of an expression of a jet; the jet's last order may not occur in it.

    By the chain rule, sum_k (d expression / d y^(k)) y^(k+1).
    """
    return sum((ca.jtimes(expression, y, after) for y, after in pairwise(jet)), ca.SX(0))


def along_path(path: Sequence[Any], squared_speed: Sequence[Any]) -> list[Any]:
    """Return the jet of a path y(s) travelled with ds/dt = sqrt(b(s)), eqs. (6) and (9).

    Args:
        path: y and its derivatives with respect to s, up to order beta.
        squared_speed: b and its derivatives with respect to s, up to order beta - 1; arrays broadcast
            against the path's, or symbols.

    Returns:
        y and its derivatives with respect to time, as many as the path has.

    Eq. (6), with its misprints corrected (ds/dt squared is b, and the second derivative b'/2), goes on
    as d^i s/dt^i = 1/2 d^(i-2) b'/dt^(i-2).
    """
    motion = [squared_speed[0] ** 0.5]
    for i in range(2, len(path)):
        motion.append(composed(squared_speed[1:], motion, i - 2) / 2)
    return [composed(path, motion, n) for n in range(len(path))]
