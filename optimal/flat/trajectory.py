"""The motion in time given by weights p_i(s) and squared path speed b(s), paper eqs. (6), (7), (9).

The path y(s) = sum p_i(s) y_i(s), sum p_i = 1, is travelled with ds/dt = sqrt(b(s)). Flat output, states and
inputs follow from the path and its time law (`optimal.systems`). The paper misprints eq. (6) as s^2 = b and
ds/dt = b'/2, and the time element as ds/sqrt(s). The correct forms are

    dt = ds / sqrt(b),    d2s/dt2 = b'/2.

On every interval b is a positive polynomial. Time is computed by Gauss-Legendre quadrature on panels of an
interval. The inverse, from time to path coordinate, is computed by Newton's method to machine precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline

from flatgym.quadrotor import Array, Quadrotor, nearest_turn
from optimal.flat.bounds import UNKNOWN, control_range, distance_bound, support_bound
from optimal.flights.trajectory import Samples, sample
from optimal.paths.curves import Path
from optimal.systems import FlatSystem, PlanarQuadrotor, along_path

PANELS, QUADRATURE = 16, np.polynomial.legendre.leggauss(16)
"""Panels of an interval, and nodes and weights of the quadrature on a panel."""
NEWTON_STEPS = 20
"""Most Newton steps from a time to its path coordinate."""
SAMPLES = 32
"""Points per interval at which angles are unwrapped."""


@dataclass(frozen=True, eq=False)
class FlatTrajectory:
    """A motion of a flat system along a path, known at every instant.

    At a breakpoint the highest derivatives may jump. Values there are those of the interval that begins at
    the breakpoint.

    Attributes:
        system: the flat system.
        outer_paths: the k paths y_i(s), s from 0 to 1; a single path is followed.
        nodes: path coordinates between which all functions are smooth, from 0 to 1, shape (N + 1,).
        weights: the first k - 1 weights p_i(s), a spline of shape (..., k - 1).
        squared_speed: b(s) [1/s^2], a spline.
    """

    system: FlatSystem
    outer_paths: tuple[Path, ...]
    nodes: Array
    weights: BSpline
    squared_speed: BSpline

    @property
    def quadrotor(self) -> Quadrotor:
        """The planar quadrotor. Raises AttributeError for another system."""
        if not isinstance(self.system, PlanarQuadrotor):
            raise AttributeError(f"this is the motion of a {type(self.system).__name__}; use the attribute `system`")
        return self.system.quadrotor

    @property
    def duration(self) -> float:
        """The time T of eq. (7) [s]."""
        return float(self.breakpoints[-1])

    @property
    def breakpoints(self) -> Array:
        """Times of the nodes [s], from 0 to duration, shape (N + 1,)."""
        return self._panels[1][::PANELS]

    @cached_property
    def _panels(self) -> tuple[Array, Array]:
        """Path coordinates and times [s] at the ends of the panels, shape (N PANELS + 1,) each."""
        share = np.arange(PANELS) / PANELS
        s = np.append((self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * share).ravel(), self.nodes[-1])
        return s, np.append(0.0, np.cumsum(self._elapsed(s[:-1], s[1:])))

    def _elapsed(self, begin: Array, end: Array) -> Array:
        """Return the integrals of ds/sqrt(b) from begin to end, each within one panel [s]."""
        points, weights = (QUADRATURE[0] + 1) / 2, QUADRATURE[1] / 2
        width = end - begin
        s = begin[..., None] + width[..., None] * points
        return width * (self.squared_speed(s) ** -0.5 @ weights)

    def path_coordinate(self, t: ArrayLike) -> Array:
        """Return the path coordinate s at times t in [0, duration] [s], shape (...).

        Raises:
            ValueError: for times outside the motion.
        """
        t = np.asarray(t, dtype=np.float64)
        slack = 1e-9 * self.duration
        if not np.all((t >= -slack) & (t <= self.duration + slack)):
            raise ValueError(f"t must lie within the flight, from 0 to {self.duration} s, got {t}")
        ends, times = self._panels
        panel = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(ends) - 2)
        begin, end = ends[panel], ends[panel + 1]
        elapsed = t - times[panel]
        s = begin + (end - begin) * elapsed / np.diff(times)[panel]
        for _ in range(NEWTON_STEPS):
            step = (elapsed - self._elapsed(begin, s)) * np.sqrt(self.squared_speed(s))
            s = np.clip(s + step, begin, end)
            if np.all(np.abs(step) <= 1e-15):
                break
        return s

    def path(self, s: ArrayLike, order: int = 0) -> Array:
        """Return the path y(s) or its derivative of that order with respect to s, shape (..., outputs).

        Raises:
            ValueError: for an order or a coordinate outside its range.
        """
        s = np.asarray(s, dtype=np.float64)
        if not np.all((s >= 0) & (s <= 1)):
            raise ValueError(f"s must lie in [0, 1], got {s}")
        self._require_order(order)
        return self._path_derivatives(s, order)[order]

    def _require_order(self, order: int) -> None:
        if order not in range(self.system.order + 1):
            known = ", ".join(map(str, range(self.system.order + 1)))
            raise ValueError(f"order must be one of {known}, got {order!r}")

    def _path_derivatives(self, s: Array, order: int) -> list[Array]:
        """Return y and its derivatives with respect to s up to an order, by Leibniz' rule, eq. (9)."""
        last = [self.outer_paths[-1](s, k) for k in range(order + 1)]
        apart = [[path(s, k) - last[k] for k in range(order + 1)] for path in self.outer_paths[:-1]]
        weights = [self.weights(s, nu=k) for k in range(order + 1)] if apart else []
        return [
            last[o]
            + sum(
                comb(o, k) * weights[k][..., i, None] * difference[o - k]
                for i, difference in enumerate(apart)
                for k in range(o + 1)
            )
            for o in range(order + 1)
        ]

    def jet(self, s: ArrayLike) -> list[Array]:
        """Return the flat output and its time derivatives at path coordinates s, shape (..., outputs) each."""
        s = np.asarray(s, dtype=np.float64)
        speed = [self.squared_speed(s, nu=k)[..., None] for k in range(self.system.order)]
        return along_path(self._path_derivatives(s, self.system.order), speed)

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the flat output or its derivative of that order in time.

        Args:
            t: times from 0 to duration [s], shape (...).
            order: from 0 to the system's order.

        Returns:
            Shape (..., outputs).

        Raises:
            ValueError: for an order or a time outside its range.
        """
        self._require_order(order)
        return self.jet(self.path_coordinate(t))[order]

    def state(self, t: ArrayLike) -> Array:
        """Return the states at times t [s], shape (..., states). Angles are continuous from the start."""
        state, _ = self.system.state_and_input(self.jet(self.path_coordinate(t)))
        for i, (times, angle) in self._unwrapped_angles.items():
            near = np.interp(np.asarray(t, dtype=np.float64), times, angle)
            state[..., i] = nearest_turn(state[..., i], near)
        return state

    def control(self, t: ArrayLike) -> Array:
        """Return the inputs at times t [s], shape (..., inputs)."""
        return self.system.state_and_input(self.jet(self.path_coordinate(t)))[1]

    @cached_property
    def _unwrapped_angles(self) -> dict[int, tuple[Array, Array]]:
        """Times [s] and unwrapped values [rad] of every angle along the motion, by the index of its state."""
        s = self.interval_points(SAMPLES)
        state, _ = self.system.state_and_input(self.jet(s))
        ends, panel_times = self._panels
        panel = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(ends) - 2)
        times = panel_times[panel] + self._elapsed(ends[panel], s)
        return {i: (times.ravel(), np.unwrap(state[..., i].ravel())) for i in self.system.angles}

    def sample(self, dt: float) -> Samples:
        """Return the motion at times 0, dt, 2 dt, ... [s] and at its end."""
        return sample(self, dt)

    def interval_points(self, points: int) -> Array:
        """Return equidistant path coordinates in each interval, shape (N, points + 1).

        The right end of an interval is taken from inside, for the derivatives on its own side of the node.
        """
        s = self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * np.linspace(0.0, 1.0, points + 1)
        s[:, -1] = np.nextafter(self.nodes[1:], -1.0)
        return s

    def control_range(self) -> Array:
        """Return proven least and greatest [thrust, rate], shape (2, 2); infinite where no bound is proven."""
        if not isinstance(self.system, PlanarQuadrotor):
            return UNKNOWN
        return control_range(self, self.system.quadrotor.gravity)

    def support_bound(self, direction: Array) -> float:
        """Return a proven upper bound of position . direction [m]; inf where no bound is proven."""
        return support_bound(self, direction)

    def distance_bound(self, point: Array) -> float:
        """Return a proven lower bound of the distance to a point [m]; 0 where no bound is proven."""
        return distance_bound(self, point)
