"""Events within one step: line crossings, lowest points and closest approaches on the exact arc.

Under a constant control the position within a step is known in closed form. An event is a root of a smooth scalar
function on the arc itself, not on the chord between samples.

For the distance to a line with normal n, the intervals on which it is monotone are known too. Its second derivative

    n . p'' = f cos(theta - beta) + n . c,   beta the tilt at which thrust points along n,

with c the acceleration by gravity and wind, is zero at theta = beta +- arccos(-n . c / f). Between these tilts the
velocity along n is monotone and has at most one root. Between those roots the distance is monotone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array, Quadrotor

Function = Callable[[Array], tuple[Array, Array]]

ROOT_ITERATIONS = 60
"""Maximum number of Newton or bisection iterations."""
ROOT_WIDTH = 1e-12
"""Width of the final bracket of a root [s]; at 20 m/s this is 2e-11 m."""
SAGITTA_TOLERANCE = 1e-10
"""Sagitta below which a part of an arc is not divided further [m]."""


def rising_root(function: Function, low: Array, high: Array) -> Array:
    """Return the root of `function` in each bracket [low, high], shape (n,).

    Args:
        function: maps times (n,) to values (n,) and slopes (n,); negative at `low`, nonnegative at `high`.
        low, high: the brackets [s], shape (n,).

    Newton's method, with bisection where it leaves the bracket. The result is the upper end of the final bracket, so
    the value there is not negative.
    """
    low, high = low.copy(), high.copy()
    time = (low + high) / 2
    for _ in range(ROOT_ITERATIONS):
        value, slope = function(time)
        rising = value >= 0
        high = np.where(rising, time, high)
        low = np.where(rising, low, time)
        if np.all(high - low <= ROOT_WIDTH):
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = time - value / slope
        # Slightly beyond Newton's point, so that both ends of the bracket move.
        newton = newton + np.where(rising, -ROOT_WIDTH, ROOT_WIDTH) / 4
        inside = (newton > low) & (newton < high)
        time = np.where(inside, newton, (low + high) / 2)
    return high


class Arc:
    """The paths of n vehicles over one step.

    Args:
        quadrotor: the vehicle.
        state: states at the beginning of the step, shape (n, 5).
        control: constant controls [thrust, rate], shape (n, 2).
        dt: duration of the step [s], a number or shape (n,).
        wind: constant acceleration in addition to gravity [m/s^2], shape (n, 2) or (2,).
    """

    def __init__(
        self, quadrotor: Quadrotor, state: Array, control: Array, dt: Array | float, wind: ArrayLike = 0.0
    ) -> None:
        self.quadrotor, self.state, self.control = quadrotor, state, control
        self.dt = np.broadcast_to(np.asarray(dt, dtype=np.float64), (len(state),))
        self.wind = np.broadcast_to(np.asarray(wind, dtype=np.float64), (len(state), 2))

    def __getitem__(self, rows: NDArray[Any]) -> Arc:
        """Return the arcs of the vehicles selected by a mask or by indices."""
        return Arc(self.quadrotor, self.state[rows], self.control[rows], self.dt[rows], self.wind[rows])

    def __len__(self) -> int:
        return len(self.state)

    @property
    def reach(self) -> Array:
        """A bound of the distance travelled within the step [m], shape (n,); it rules out most events."""
        speed = np.hypot(self.state[:, 2], self.state[:, 3])
        return speed * self.dt + self.acceleration_bound * self.dt**2

    @property
    def pull(self) -> Array:
        """Constant acceleration by gravity and wind [m/s^2], shape (n, 2)."""
        return self.wind - np.array([0.0, self.quadrotor.gravity])

    @property
    def acceleration_bound(self) -> Array:
        """A bound of |p''| [m/s^2], shape (n,)."""
        return self.control[:, 0] + np.hypot(self.pull[:, 0], self.pull[:, 1])

    def at(self, time: Array | float) -> Array:
        """Return the states `time` seconds into the step, shape (n, 5)."""
        state = self.quadrotor.step(self.state, self.control, time)
        blown = np.broadcast_to(time, (len(self),))[:, None] * self.wind
        state[:, 0:2] += blown * np.reshape(time, (-1, 1)) / 2
        state[:, 2:4] += blown
        return state

    def derivative(self, state: Array) -> Array:
        """Return d(state)/dt at a state of these arcs, shape (n, 5)."""
        derivative = self.quadrotor.derivative(state, self.control)
        derivative[:, 2:4] += self.wind
        return derivative

    def inflections(self, direction: Array) -> Array:
        """Return the two times at which p'' . direction is zero; dt where there is none [s], shape (n, 2).

        Each of the two tilts occurs at most once, because a scenario's dt excludes a whole turn within a step.
        """
        (thrust, rate), theta = self.control.T, self.state[:, 4]
        ratio = -np.sum(self.pull * direction, axis=-1) / np.maximum(thrust, 1e-300)
        beta = np.arctan2(direction[:, 0], direction[:, 1])
        spread = np.where(np.abs(ratio) <= 1, np.arccos(np.clip(ratio, -1, 1)), np.nan)
        tilt = beta[:, None] + spread[:, None] * np.array([-1.0, 1.0])
        turn = np.sign(rate)[:, None] * (tilt - theta[:, None]) % (2 * np.pi)
        with np.errstate(divide="ignore", invalid="ignore"):
            time = turn / np.abs(rate)[:, None]
        return np.where(time < self.dt[:, None], time, self.dt[:, None])

    def height_over(self, point: Array, direction: Array, time: Array) -> tuple[Array, Array]:
        """Return (p - point) . direction [m] and its time derivative, each shape (n,)."""
        state = self.at(time)
        return np.sum((state[:, 0:2] - point) * direction, axis=-1), np.sum(state[:, 2:4] * direction, axis=-1)

    def speed_along(self, direction: Array, time: Array) -> tuple[Array, Array]:
        """Return p' . direction [m/s] and its time derivative, each shape (n,)."""
        state = self.at(time)
        acceleration = self.derivative(state)[:, 2:4]
        return np.sum(state[:, 2:4] * direction, axis=-1), np.sum(acceleration * direction, axis=-1)

    def approach(self, point: Array, time: Array) -> tuple[Array, Array]:
        """Return half the rate of change of |p - point|^2 [m^2/s] and its time derivative, each shape (n,)."""
        state = self.at(time)
        offset, velocity, acceleration = state[:, 0:2] - point, state[:, 2:4], self.derivative(state)[:, 2:4]
        return np.sum(offset * velocity, axis=-1), np.sum(velocity**2 + offset * acceleration, axis=-1)

    def monotone_times(self, direction: Array) -> Array:
        """Return five times from 0 to dt; between two of them p . direction is monotone [s], shape (5, n)."""
        start = np.zeros(len(self))
        knots = np.sort(np.stack([start, *self.inflections(direction).T, self.dt]), axis=0)
        slopes = [self.speed_along(direction, t)[0] for t in knots]
        times = [start]
        for low, high, before, after in zip(knots[:-1], knots[1:], slopes[:-1], slopes[1:], strict=True):
            turns = before * after < 0
            time = high.copy()
            if turns.any():
                arc, normal = self[turns], np.sign(after[turns])[:, None] * direction[turns]
                time[turns] = rising_root(partial(arc.speed_along, normal), low[turns], high[turns])
            times.append(time)
        return np.stack([*times, self.dt])

    def crossing(self, point: Array, direction: Array, after: Array) -> Array:
        """Return the first time later than `after` at which each path crosses a line from below to above.

        Args:
            point: a point of the line [m], shape (n, 2).
            direction: the unit normal of the line, in the direction of passage, shape (n, 2).
            after: times before which crossings do not count [s], shape (n,).

        Returns:
            Times within the step [s], shape (n,); nan without a crossing.
        """
        times = np.maximum(self.monotone_times(direction), after)
        values = [self.height_over(point, direction, t)[0] for t in times]
        found = np.full(len(self), np.nan)
        for low, high, before, then in zip(times[:-1], times[1:], values[:-1], values[1:], strict=True):
            rises = (before < 0) & (then >= 0) & np.isnan(found)
            if rises.any():
                arc = self[rises]
                found[rises] = rising_root(
                    partial(arc.height_over, point[rises], direction[rises]), low[rises], high[rises]
                )
        return found

    def lowest(self, direction: Array) -> Array:
        """Return the minimum of p . direction over the step [m] for a vector (2,), shape (n,)."""
        origin, along = np.zeros((len(self), 2)), np.broadcast_to(direction, (len(self), 2))
        return np.min([self.height_over(origin, along, t)[0] for t in self.monotone_times(along)], axis=0)

    def distance(self, point: Array, within: float = np.inf) -> Array:
        """Return a proven lower bound of the distance to points over the step [m], shape (n,), tight to 1e-9.

        Let r = |p - point|^2 / 2 and c the acceleration by gravity and wind. On a part of the step |p'''| <= f |omega|,
        and |p''| is at most f + |c| and at most its initial value plus f |omega| times the length of the part. This
        bounds r'''. A part on which r is shown to be monotone or convex has its minimum at an end or at the root of
        r'. A part whose chord distance minus the sagitta bound exceeds the minimum so far is discarded. Other parts are
        bisected.

        Args:
            point: shape (n, 2) [m].
            within: distances from this value on need not be resolved; any value >= `within` stands for them [m].
        """
        low, high, row = np.zeros(len(self)), self.dt.copy(), np.arange(len(self))
        least = np.minimum(self._distance_at(point, low), self._distance_at(point, high))
        while row.size:
            arc, p = self[row], point[row]
            before, after, most = arc._approach_bounds(p, low, high)
            sagitta = most * (high - low) ** 2 / 8
            floor = _chord_distance(before[0], after[0]) - sagitta
            rising = (np.minimum(before[1], after[1]) >= after[3]) | (np.maximum(before[1], after[1]) <= -after[3])
            convex = np.minimum(before[2], after[2]) >= before[3]
            turns = convex & ~rising & (before[1] < 0) & (after[1] > 0) & (floor < least[row])
            if turns.any():
                chosen, target = arc[turns], p[turns]
                time = rising_root(partial(chosen.approach, target), low[turns], high[turns])
                np.minimum.at(least, row[turns], chosen._distance_at(target, time))
            # Parts with a tiny sagitta count with their lower bound.
            left = ~(rising | convex) & (floor < np.minimum(least[row], within))
            fine = left & (sagitta <= SAGITTA_TOLERANCE)
            np.minimum.at(least, row[fine], floor[fine])
            left &= ~fine
            middle = (low[left] + high[left]) / 2
            row, low, high = np.tile(row[left], 2), np.append(low[left], middle), np.append(middle, high[left])
            near = self._distance_at(point[row], low, row)
            np.minimum.at(least, row, near)
        return np.maximum(least, 0.0)

    def _approach_bounds(self, point: Array, low: Array, high: Array) -> Any:
        """Return (offset, r', r'', error bound) at both ends of parts [low, high], and a bound of |p''|.

        See `distance` for r. The first error bound is how far r'' may fall below its smaller end value, the second how
        far r' may deviate from its chord.
        """
        width, jerk = high - low, self.control[:, 0] * np.abs(self.control[:, 1])
        found = []
        for time in (low, high):
            state = self.at(time)
            offset, velocity, acceleration = state[:, 0:2] - point, state[:, 2:4], self.derivative(state)[:, 2:4]
            slope = np.sum(offset * velocity, axis=-1)
            bend = np.sum(velocity**2 + offset * acceleration, axis=-1)
            found.append((offset, slope, bend))
            if time is low:
                # A hovering vehicle has almost no acceleration; this bound then ends the bisection early.
                most = np.hypot(acceleration[:, 0], acceleration[:, 1]) + jerk * width
                pull = np.minimum(self.acceleration_bound, most)
                speed = np.hypot(velocity[:, 0], velocity[:, 1]) + pull * width
                away = np.hypot(offset[:, 0], offset[:, 1]) + speed * width
        third = 3 * speed * pull + away * jerk
        return (*found[0], third * width / 2), (*found[1], third * width**2 / 8), pull

    def _distance_at(self, point: Array, time: Array, row: NDArray[Any] | None = None) -> Array:
        """Return the distances to points at times, of all arcs or of those at `row`, shape (n,)."""
        arc = self if row is None else self[row]
        offset = arc.at(time)[:, 0:2] - point
        return np.hypot(offset[:, 0], offset[:, 1])


def _chord_distance(before: Array, after: Array) -> Array:
    """Return the distances of the origin to segments between points (n, 2), shape (n,)."""
    chord = after - before
    length = np.maximum(np.sum(chord**2, axis=-1), 1e-300)
    share = np.clip(-np.sum(before * chord, axis=-1) / length, 0.0, 1.0)
    nearest = before + share[:, None] * chord
    return np.hypot(nearest[:, 0], nearest[:, 1])
