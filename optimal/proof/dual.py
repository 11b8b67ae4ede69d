"""The dual of time-optimal flight: multipliers that exclude all flights of a given time.

Position and velocity enter the dynamics linearly. Let the weight q(t) be piecewise linear, with slope jumps k_i at
times s_i. For any flight that starts at rest, two integrations by parts give, with positions p relative to the start,

    integral of q . a dt = q(T) . v(T) - q'(T) . p(T) + sum over i of k_i . p(s_i).

A scenario restricts p(T), v(T) and p(s_i): by goal and tolerance, by the gap of a hoop passed at s_i, and by floor and
ceiling at any s_i. These restrictions bound the right side from below by R(q), a support function. With D from start
to goal,

    R = -q'(T) . D - position |q'(T)| - speed |q(T)|
        + sum over hoops (k . (centre - start) - gap |k . across|)
        + sum over floor kinks (k_z >= 0) k_z floor + sum over ceiling kinks (k_z <= 0) k_z ceiling.

`optimal.proof.tilt_program` bounds the left side from above by J(q). If F = J - R < 0 for one q, no flight takes the
time T. No flight takes less either, because it could hover first. F is convex and positively homogeneous in all
multipliers.

Hoops. The passing time of a hoop is unknown, so one set of multipliers must exclude every passing time in an interval
[a, b]. The weight for a passing time has its kink there and is otherwise the same. Outside [a, b] the weight is affine
in the passing time, and R is concave in it. F is therefore at most the greater of its values at the two ends, plus a
correction from inside [a, b]. There the weight equals the convex combination of the two end weights minus k times a
nonnegative function of time. For the passing time s, the integral of this function is (b - s)(s - a)/2 <= (b - a)^2/8.
The correction is at most (thrust_max |k| + g k_z) (b - a)^2/8. With several hoops F is bounded in this way in each
passing time, so all combinations of ends are evaluated.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance
from optimal.proof.branches import Branch
from optimal.proof.rounding import LEAST_LENGTH, UNIT_ROUNDOFF
from optimal.proof.tilt_program import TiltProgram
from optimal.proof.time_grid import TimeGrid

ROUNDING_UNITS = 256
"""Rounding error of R and of the weight, in units in the last place of the magnitudes of all their terms."""


class Cut(NamedTuple):
    """A cutting plane of F: its value at some multipliers, a bound of the rounding error, and a subgradient.

    F(y) >= slope . y for all y.
    """

    value: float
    rounding: float
    slope: Array


class Dual:
    """F of one scenario, grid and branch.

    The multipliers y are, in this order and all in the unit of q: q(0); T q'(0); T k of each hoop (2 components each);
    T |k_z| of the floor kinks and of the ceiling kinks; and the penalties of first and last tilt times
    rate_max/thrust_max. Multipliers with an index in `signed` must be nonnegative.

    Args:
        scenario: the task.
        grid: instants and angles of the dynamic programme.
        branch: the class of flights.
        tolerance: goal tolerance; None requires exact rest at the goal.
        kinks: times at which the slope of q may jump at floor and ceiling, as shares of T.
    """

    def __init__(
        self,
        scenario: Scenario,
        grid: TimeGrid,
        branch: Branch,
        tolerance: Tolerance | None = None,
        kinks: Sequence[float] = (),
    ) -> None:
        self.quadrotor, self.grid = scenario.quadrotor, grid
        self._program = TiltProgram(
            scenario.quadrotor, grid, branch.winding, tolerance.angle if tolerance else 0.0, branch.held
        )
        self._share = np.arange(grid.steps + 1) / grid.steps
        at = np.rint(np.array(kinks) * grid.steps) / grid.steps
        limits = [(1.0, scenario.floor), (-1.0, scenario.ceiling)]
        heights = [(sign, height - scenario.start[1]) for sign, height in limits if height is not None]
        self._signs = np.repeat([sign for sign, _ in heights], len(at))
        self._bends = np.maximum(self._share[:, None] - np.tile(at, len(heights)), 0.0)
        passing = np.array(branch.passing).reshape(-1, 2) * grid.steps
        self._passing = np.column_stack([np.floor(passing[:, 0]), np.ceil(passing[:, 1])]) / grid.steps
        self.vectors = 2 * (2 + len(scenario.hoops))
        self.size = self.vectors + len(self._signs) + 2
        self.signed = np.arange(self.vectors, self.size)
        self._linear, self._norms = self._remainder(scenario, tolerance, np.repeat([h for _, h in heights], len(at)))
        self._speed = tolerance.speed if tolerance else 0.0
        # The weight is a sum of multipliers times shares of at most 1. Its terms may cancel, so their magnitudes count.
        vehicle = scenario.quadrotor
        self._size = np.abs(self._linear) + grid.time * (vehicle.thrust_max + vehicle.gravity)
        for factor, matrix in self._norms:
            self._size = self._size + factor * np.abs(matrix).sum(axis=0)

    @property
    def possible(self) -> bool:
        """Whether the branch can contain a flight: turns take time, and hoops are passed in order."""
        return self._program.possible and bool((self._passing[1:, 1] >= self._passing[:-1, 0]).all())

    def __call__(self, multipliers: Array) -> list[Cut]:
        """Return F for each combination of ends of the passing intervals. The greatest value is the bound."""
        return [self._cut(multipliers, np.array(times)) for times in product(*map(np.unique, self._passing))]

    def _remainder(
        self, scenario: Scenario, tolerance: Tolerance | None, heights: Array
    ) -> tuple[Array, list[tuple[float, Array]]]:
        """Return -R plus the corrections of the passing intervals, as l and (c, M): l . y + sum of c |M y|."""
        duration, vehicle = self.grid.time, self.quadrotor
        unit = np.eye(self.size)
        end_slope = unit[2 : self.vectors].reshape(-1, 2, self.size).sum(axis=0)
        end_slope[1, self.vectors : -2] = self._signs
        linear = (np.array(scenario.goal) - scenario.start) @ end_slope / duration
        linear[self.vectors : -2] -= self._signs * heights / duration
        norms = [(tolerance.position / duration if tolerance else 0.0, end_slope)]
        for i, hoop in enumerate(scenario.hoops):
            kink = unit[4 + 2 * i : 6 + 2 * i]
            linear -= (hoop.centre - scenario.start) @ kink / duration
            norms.append((hoop.half_gap(vehicle.radius) / duration, hoop.across[None] @ kink))
            inside = duration * float(np.diff(self._passing[i])[0]) ** 2 / 8
            linear += vehicle.gravity * inside * kink[1]
            norms.append((vehicle.thrust_max * inside, kink))
        return linear, [(factor, matrix) for factor, matrix in norms if factor > 0]

    def _cut(self, y: Array, times: Array) -> Cut:
        """Return the cutting plane at y, for given passing times of the hoops as shares of T."""
        scale = self.quadrotor.thrust_max / self.quadrotor.rate_max
        basis = np.empty((len(self._share), 2 + len(times)))
        basis[:, 0], basis[:, 1] = 1.0, self._share
        np.maximum(self._share[:, None] - times, 0.0, out=basis[:, 2:])
        weight = basis @ y[: self.vectors].reshape(-1, 2)
        if self._signs.size:
            weight[:, 1] += self._bends @ (self._signs * y[self.vectors : -2])
        bound = self._program(weight, *(scale * y[-2:]))
        slope, value = self._linear.copy(), bound.value + bound.interpolation + float(self._linear @ y)
        for factor, matrix in self._norms:
            vector = matrix @ y
            length = float(np.hypot.reduce(vector))  # does not underflow
            value += factor * length
            slope += factor / max(length, LEAST_LENGTH) * (vector @ matrix)
        end = np.array(weight[-1])
        value += self._speed * float(np.hypot(*end))
        by_weight = bound.slope.copy()
        by_weight[-1] += self._speed / max(float(np.hypot(*end)), LEAST_LENGTH) * end
        slope[: self.vectors] += (basis.T @ by_weight).ravel()
        slope[self.vectors : -2] += self._signs * (self._bends.T @ by_weight[:, 1])
        slope[-2:] += scale * bound.ends
        size = np.abs(y) @ self._size
        return Cut(value, bound.rounding + ROUNDING_UNITS * UNIT_ROUNDOFF * float(size), slope)


def hoop_kinks(multipliers: Array, hoops: int) -> Array:
    """Return T k of each hoop, shape (H, 2), from the multipliers of a `Dual`."""
    return multipliers[4 : 4 + 2 * hoops].reshape(-1, 2)
