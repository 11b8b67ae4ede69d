"""The flight in time that weights p(s) and squared path speed b(s) describe, paper eqs. (6) and (9).

The path is y(s) = p(s) y_1(s) + (1 - p(s)) y_2(s), and it is travelled with s' = sqrt(b(s)):

    ds/dt = sqrt(b),   d2s/dt2 = b'/2,   d3s/dt3 = b'' sqrt(b) / 2,                          (6)
    velocity     = y' sqrt(b)
    acceleration = y'' b + y' b'/2                                                           (9)
    jerk         = (y''' b + 3/2 y'' b' + 1/2 y' b'') sqrt(b).

(Primes are derivatives with respect to s. The paper misprints eq. (6) as s^2 = b and ds/dt = b'/2,
and the time element as ds/sqrt(s); it is dt = ds/sqrt(b).) Thrust, tilt and rate follow from

    f = |a + g e_z|,   tan(theta) = x''/(z'' + g),
    omega = (x''' (z'' + g) - x'' z''') / ((z'' + g)^2 + x''^2),

time derivatives here; the paper misprints the numerator as x'' (z'' + g) - x'' z''.

On every interval p is cubic and b quadratic, b = b0 + b1 u + b2 u^2. There eq. (6) says
d2u/dt2 = b1/2 + b2 u, a linear equation, so that time and path coordinate are exact functions of
each other: u = sqrt(b0) S + (b1/2) C with S = sinh(k t)/k, C = (cosh(k t) - 1)/k^2, k^2 = b2, and
tanh(k t/2)/k = u / (sqrt(b0) + sqrt(b)); for b2 < 0 the same with trigonometric functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array, Quadrotor
from optimal.paths import OuterPaths
from optimal.trajectory import Samples, sample

TILT_SAMPLES = 32
"""Points per interval along which the tilt is followed, so that it is known beyond one turn."""


def _sinhc(square: Array) -> Array:
    """Return sinh(r)/r with r^2 = square, which is sin(|r|)/|r| where square < 0."""
    root = np.sqrt(np.abs(square))
    safe = np.where(root > 0, root, 1.0)
    hyperbolic = np.where(root > 0, np.sinh(np.where(square > 0, root, 0.0)) / safe, 1.0)
    return np.where(square > 0, hyperbolic, np.sinc(root / np.pi))


def _artanhc(square: Array) -> Array:
    """Return artanh(r)/r with r^2 = square, which is arctan(|r|)/|r| where square < 0."""
    root = np.sqrt(np.abs(square))
    safe = np.where(root > 0, root, 1.0)
    inverse = np.where(square > 0, np.arctanh(np.where(square > 0, root, 0.0)), np.arctan(root))
    return np.where(root > 0, inverse / safe, 1.0)


def _polynomial(coefficients: Array, u: Array, order: int) -> Array:
    """Evaluate derivatives of polynomials, coefficients constant first, shape (degree + 1, ...)."""
    value = np.zeros_like(u)
    for power in range(len(coefficients) - 1, order - 1, -1):
        factor = float(np.prod(np.arange(power - order + 1, power + 1)))
        value = value * u + factor * coefficients[power]
    return value


@dataclass(frozen=True, eq=False)
class FlatTrajectory:
    """A flight between outer paths, in time; exact from start to end.

    At a breakpoint, where jerk and rate may jump, values are those of the interval that begins there.

    Attributes:
        nodes: path coordinates where the polynomials meet, from 0 to 1, shape (N + 1,).
        weight: coefficients of p on every interval in powers of s - node, constant first, shape (4, N).
        squared_speed: coefficients of b likewise [1/s^2], shape (3, N).
        outer_paths: the two paths; p is the weight of the first.
        quadrotor: the vehicle.
    """

    nodes: Array
    weight: Array
    squared_speed: Array
    outer_paths: OuterPaths
    quadrotor: Quadrotor

    @property
    def duration(self) -> float:
        """The flight time T of eq. (7) [s]."""
        return float(self.breakpoints[-1])

    @cached_property
    def breakpoints(self) -> Array:
        """The times of the nodes [s], from 0 to duration, shape (N + 1,)."""
        widths: Array = np.diff(self.nodes)
        return np.concatenate([[0.0], np.cumsum(self._elapsed(np.arange(len(widths)), widths))])

    def _elapsed(self, interval: NDArray[np.intp], u: Array) -> Array:
        """Return the integral of ds/sqrt(b), eq. (7), from the interval's beginning to u."""
        b = self.squared_speed[:, interval]
        speeds = np.sqrt(b[0]) + np.sqrt(_polynomial(b, u, 0))
        elapsed: Array = 2 * u / speeds * _artanhc(b[2] * (u / speeds) ** 2)
        return elapsed

    def _locate(self, t: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Return the interval and the offset s - node at times t, inverting `_elapsed` exactly."""
        t = np.asarray(t, dtype=np.float64)
        slack = 1e-9 * self.duration
        if not np.all((t >= -slack) & (t <= self.duration + slack)):
            raise ValueError(f"t must lie within the flight, from 0 to {self.duration} s, got {t}")
        interval = np.clip(np.searchsorted(self.breakpoints, t, side="right") - 1, 0, len(self.nodes) - 2)
        tau = np.clip(t - self.breakpoints[interval], 0.0, None)
        b = self.squared_speed[:, interval]
        s_term = tau * _sinhc(b[2] * tau**2)
        c_term = tau**2 / 2 * _sinhc(b[2] * tau**2 / 4) ** 2
        u = np.sqrt(b[0]) * s_term + b[1] / 2 * c_term
        return interval, np.clip(u, 0.0, np.diff(self.nodes)[interval])

    def _path(self, interval: NDArray[np.intp], u: Array, order: int) -> Array:
        """Return the derivative of y = y_2 + p (y_1 - y_2) with respect to s, by Leibniz' rule."""
        s = self.nodes[interval] + u
        first, second = self.outer_paths
        value: Array = second(s, order)
        for k in range(order + 1):
            p = _polynomial(self.weight[:, interval], u, k)
            value = value + comb(order, k) * p[..., None] * (first(s, order - k) - second(s, order - k))
        return value

    def _motion(self, interval: NDArray[np.intp], u: Array, order: int) -> Array:
        """Return the derivative of the position with respect to time, order 0 to 3, eq. (9)."""
        y = [self._path(interval, u, k) for k in range(order + 1)]
        b = [_polynomial(self.squared_speed[:, interval], u, k)[..., None] for k in range(3)]
        if order == 0:
            return y[0]
        if order == 1:
            return y[1] * np.sqrt(b[0])
        if order == 2:
            return y[2] * b[0] + y[1] * b[1] / 2
        return (y[3] * b[0] + 1.5 * y[2] * b[1] + 0.5 * y[1] * b[2]) * np.sqrt(b[0])

    def _inputs(self, interval: NDArray[np.intp], u: Array) -> tuple[Array, Array, Array]:
        """Return thrust, rate, and the tilt within half a turn, section II-A (rate as corrected above)."""
        acceleration, jerk = self._motion(interval, u, 2), self._motion(interval, u, 3)
        side, up = acceleration[..., 0], acceleration[..., 1] + self.quadrotor.gravity
        square = side**2 + up**2
        # A thrust that passes through zero turns infinitely fast: the rate is then inf, not an error.
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.nan_to_num((jerk[..., 0] * up - side * jerk[..., 1]) / square, nan=np.inf)
        return np.sqrt(square), rate, np.arctan2(side, up)

    def path(self, s: ArrayLike, order: int = 0) -> Array:
        """Return the geometric path y(s) or its derivative with respect to s [m].

        Args:
            s: path coordinates in [0, 1], shape (...).
            order: 0 to 3.

        Returns:
            Shape (..., 2).

        Raises:
            ValueError: for an order or a coordinate outside its range.
        """
        self._check_order(order)
        s = np.asarray(s, dtype=np.float64)
        if not np.all((s >= 0) & (s <= 1)):
            raise ValueError(f"s must lie in [0, 1], got {s}")
        interval = np.clip(np.searchsorted(self.nodes, s, side="right") - 1, 0, len(self.nodes) - 2)
        return self._path(interval, s - self.nodes[interval], order)

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return position, velocity, acceleration or jerk, as order is 0, 1, 2 or 3.

        Args:
            t: times from 0 to duration [s], shape (...).
            order: of the derivative with respect to time.

        Returns:
            Components along x and z [m/s^order], shape (..., 2).

        Raises:
            ValueError: for an order or a time outside its range.
        """
        self._check_order(order)
        return self._motion(*self._locate(t), order)

    @staticmethod
    def _check_order(order: int) -> None:
        if order not in (0, 1, 2, 3):
            raise ValueError(f"order must be 0, 1, 2 or 3, got {order!r}")

    @cached_property
    def _followed_tilt(self) -> tuple[Array, Array]:
        """Times and continuous tilt at many points along the flight."""
        interval, u = self.grid(TILT_SAMPLES)
        times = self.breakpoints[interval] + self._elapsed(interval, u)
        return times.ravel(), np.unwrap(self._inputs(interval, u)[2].ravel())

    def state(self, t: ArrayLike) -> Array:
        """Return the states [x, z, vx, vz, theta] at times t [s], theta continuous from 0, shape (..., 5)."""
        interval, u = self._locate(t)
        tilt = self._inputs(interval, u)[2]
        followed = np.interp(np.asarray(t, dtype=np.float64), *self._followed_tilt)
        tilt = tilt + 2 * np.pi * np.round((followed - tilt) / (2 * np.pi))
        parts = self._motion(interval, u, 0), self._motion(interval, u, 1), tilt[..., None]
        return np.concatenate(parts, axis=-1)

    def control(self, t: ArrayLike) -> Array:
        """Return the controls [thrust, rate] at times t [s], in [m/s^2] and [rad/s], shape (..., 2)."""
        thrust, rate, _ = self._inputs(*self._locate(t))
        return np.stack([thrust, rate], axis=-1)

    def sample(self, dt: float) -> Samples:
        """Return the flight at 0, dt, 2 dt, ... [s], and at its end."""
        return sample(self, dt)

    def grid(self, points: int) -> tuple[NDArray[np.intp], Array]:
        """Return interval and offset of equidistant points, both ends included, shapes (N, points + 1)."""
        share = np.linspace(0.0, 1.0, points + 1)
        widths = np.diff(self.nodes)
        return np.broadcast_to(np.arange(len(widths))[:, None], (len(widths), points + 1)), widths[:, None] * share

    def excess(self, points: int = 32) -> Array:
        """Return how far each interval oversteps each limit, in continuous time.

        The maxima are found among `points` samples per interval, each side of a node with its own
        third derivatives, and once more among as many around the largest.

        Returns:
            Overstepping of thrust_max, thrust_min [m/s^2] and rate_max [rad/s]; negative is room
            left, shape (3, N).
        """
        interval, u = self.grid(points)
        coarse = self._overstep(interval, u)
        refined = []
        for k in range(3):
            top = u[np.arange(len(u)), coarse[k].argmax(axis=1)][:, None]
            width = u[:, -1:]
            near = np.clip(top + width / points * np.linspace(-1, 1, points + 1), 0, width)
            refined.append(np.maximum(coarse[k].max(axis=1), self._overstep(interval, near)[k].max(axis=1)))
        return np.array(refined)

    def _overstep(self, interval: NDArray[np.intp], u: Array) -> Array:
        thrust, rate, _ = self._inputs(interval, u)
        vehicle = self.quadrotor
        return np.array([thrust - vehicle.thrust_max, vehicle.thrust_min - thrust, np.abs(rate) - vehicle.rate_max])

    def violation(self, points: int = 32) -> float:
        """Return the largest overstepping of a control limit relative to that limit, at least 0.

        A thrust_min of 0 is compared with gravity instead.
        """
        vehicle = self.quadrotor
        scale = np.array([vehicle.thrust_max, vehicle.thrust_min or vehicle.gravity, vehicle.rate_max])
        return max(0.0, float((self.excess(points) / scale[:, None]).max()))
