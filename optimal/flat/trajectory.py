"""The motion in time that weights p_i(s) and squared path speed b(s) describe, paper eqs. (6), (7), (9).

The path y(s) = sum p_i(s) y_i(s), sum p_i = 1, is travelled with ds/dt = sqrt(b(s)). The flat output
and its time derivatives follow, and states and inputs from those (`optimal.systems`). The paper
misprints eq. (6) as s^2 = b and ds/dt = b'/2, and the time element as ds/sqrt(s); it is

    dt = ds / sqrt(b),    d2s/dt2 = b'/2.

On every interval b is a polynomial, positive, and time is an integral by Gauss-Legendre quadrature
on panels of an interval; the way back from time to path coordinate is Newton's method, to the last digit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
NEWTON_STEPS = 20
HASTE = 1.02
"""By what factor a slow motion is hastened at a time."""
SAMPLES, CLOSER = 32, 8
"""Points per interval at which limits are looked at and angles followed, and around the largest excess again."""


@dataclass(frozen=True, eq=False)
class FlatTrajectory:
    """A motion of a flat system along a path; exact from start to end.

    At a breakpoint, where the highest derivatives may jump, values are those of the interval that
    begins there.

    Attributes:
        system: what moves.
        outer_paths: the k paths y_i(s), s from 0 to 1; one alone is followed.
        nodes: path coordinates between which everything is smooth, from 0 to 1, shape (N + 1,).
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
        """The planar quadrotor flown; an AttributeError where something else moves."""
        if not isinstance(self.system, PlanarQuadrotor):
            raise AttributeError(f"this is the motion of a {type(self.system).__name__}, see `system`")
        return self.system.quadrotor

    @property
    def duration(self) -> float:
        """The time T of eq. (7) [s]."""
        return float(self.breakpoints[-1])

    @property
    def breakpoints(self) -> Array:
        """The times of the nodes [s], from 0 to duration, shape (N + 1,)."""
        return self._panels[1][::PANELS]

    @cached_property
    def _panels(self) -> tuple[Array, Array]:
        """Coordinates and times at the ends of the panels, each of shape (N PANELS + 1,)."""
        share = np.arange(PANELS) / PANELS
        s = np.append((self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * share).ravel(), self.nodes[-1])
        return s, np.append(0.0, np.cumsum(self._elapsed(s[:-1], s[1:])))

    def _elapsed(self, begin: Array, end: Array) -> Array:
        """Return the integrals of ds/sqrt(b) from begin to end, each within one panel."""
        points, weights = (QUADRATURE[0] + 1) / 2, QUADRATURE[1] / 2
        width = end - begin
        s = begin[..., None] + width[..., None] * points
        return width * (self.squared_speed(s) ** -0.5 @ weights)

    def path_coordinate(self, t: ArrayLike) -> Array:
        """Return s at times t in [0, duration] [s], shape (...).

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
        late = t - times[panel]
        s = begin + (end - begin) * late / np.diff(times)[panel]
        for _ in range(NEWTON_STEPS):
            step = (late - self._elapsed(begin, s)) * np.sqrt(self.squared_speed(s))
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
        """Return the flat output and its time derivatives at path coordinates, each of shape (..., outputs)."""
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
        """Return the states at times t [s], angles continuous from the start, shape (..., states)."""
        state, _ = self.system.state_and_input(self.jet(self.path_coordinate(t)))
        for i, (times, angle) in self._followed.items():
            near = np.interp(np.asarray(t, dtype=np.float64), times, angle)
            state[..., i] = nearest_turn(state[..., i], near)
        return state

    def control(self, t: ArrayLike) -> Array:
        """Return the inputs at times t [s], shape (..., inputs)."""
        return self.system.state_and_input(self.jet(self.path_coordinate(t)))[1]

    @cached_property
    def _followed(self) -> dict[int, tuple[Array, Array]]:
        """Times and continuous values of every angle at many points along the motion."""
        s = self._grid(SAMPLES)
        state, _ = self.system.state_and_input(self.jet(s))
        ends, panel_times = self._panels
        panel = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(ends) - 2)
        times = panel_times[panel] + self._elapsed(ends[panel], s)
        return {i: (times.ravel(), np.unwrap(state[..., i].ravel())) for i in self.system.angles}

    def sample(self, dt: float) -> Samples:
        """Return the motion at 0, dt, 2 dt, ... [s], and at its end."""
        return sample(self, dt)

    def _grid(self, points: int) -> Array:
        """Return equidistant coordinates within each interval, ends from inside, shape (N, points + 1)."""
        s = self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * np.linspace(0.0, 1.0, points + 1)
        s[:, -1] = np.nextafter(self.nodes[1:], -1.0)
        return s

    def excess(self) -> Array:
        """Return how far each interval oversteps each limit, in continuous time.

        The maxima are found among samples of every interval, each side of a node with its own highest
        derivatives, and once more around the largest.

        Returns:
            By limits of the system, relative to their scale (`FlatSystem.bounds`), negative where
            there is room: the greatest, then the least values, shape (2, limits, N); inf where a
            limit is exceeded beyond all numbers.
        """
        s = self._grid(SAMPLES)
        coarse = self._overstep(self.jet(s))
        largest = coarse.max(axis=-1)
        step = np.diff(self.nodes)[:, None] / SAMPLES * np.linspace(-1, 1, 2 * CLOSER + 1)
        top = np.take_along_axis(np.broadcast_to(s, coarse.shape), coarse.argmax(axis=-1)[..., None], axis=-1)
        near = self._overstep(self.jet(np.clip(top + step, s[:, :1], s[:, -1:])))
        for side, limit in np.ndindex(largest.shape[:2]):
            closer = near[side, limit, side, limit].max(axis=-1)
            largest[side, limit] = np.maximum(largest[side, limit], closer)
        return largest

    def _overstep(self, jet: list[Array]) -> Array:
        """Return the overstepping of greatest and least values, shape (2, limits, ...)."""
        _, _, low, high = self.system.bounds
        # A thrust that passes through zero turns infinitely fast.
        values = np.nan_to_num(self.system.limited_values(jet), nan=np.inf)
        return np.moveaxis(np.stack([values - high, low - values]), -1, 1)

    def control_range(self) -> Array:
        """Return proven bounds of [thrust, rate], least and greatest, shape (2, 2); infinite where nothing is shown."""
        if not isinstance(self.system, PlanarQuadrotor):
            return UNKNOWN
        return control_range(self, self.system.quadrotor.gravity)

    def support_bound(self, direction: Array) -> float:
        """Return a proven upper bound of position . direction [m]; inf where nothing is shown."""
        return support_bound(self, direction)

    def distance_bound(self, point: Array) -> float:
        """Return a proven lower bound of the distance to a point [m]; 0 where nothing is shown."""
        return distance_bound(self, point)

    def violation(self) -> float:
        """Return the largest overstepping of a limit relative to its scale, at least 0."""
        return max(0.0, float(self.excess().max(initial=0.0)))

    def proven_violation(self) -> float:
        """Return a proven upper bound of `violation`; 0 where nothing is shown, sampling being all there is."""
        bounds = self.control_range()
        if not np.isfinite(bounds).all():
            return 0.0
        q = self.quadrotor
        return max(
            0.0, float((np.maximum(q.control_low - bounds[0], bounds[1] - q.control_high) / q.control_high).max())
        )

    def slowed(self, most: float) -> FlatTrajectory | None:
        """Return the same path travelled just slowly enough to keep all limits.

        Slower by a factor c, the k-th time derivatives fall by c^k.

        Args:
            most: the greatest c tried; None is returned where that does not do.
        """
        s, factor = self._grid(2 * SAMPLES), 1.0
        jet = self.jet(s)
        while factor <= most:
            slower = replace(self, squared_speed=_scaled(self.squared_speed, factor**-2))
            violation = float(self._overstep([y / factor**k for k, y in enumerate(jet)]).max(initial=0.0))
            violation = violation or slower.violation() or slower.proven_violation()
            if violation == 0:
                return slower
            factor *= 1 + 1.01 * violation + 1e-9
        return None

    def hastened(self) -> FlatTrajectory | None:
        """Return the same path travelled faster and faster until a limit is met; None where one is exceeded."""
        found, faster = None, self
        while faster.violation() == 0:
            found, faster = faster, replace(faster, squared_speed=_scaled(faster.squared_speed, HASTE**2))
        return found and found.slowed(HASTE)


def _scaled(spline: BSpline, factor: float) -> BSpline:
    return BSpline(spline.t, spline.c * factor, spline.k)
