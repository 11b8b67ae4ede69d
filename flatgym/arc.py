"""What happens inside one step: crossings, lowest points and closest approaches on the exact arc.

Under a constant control the position over a step is known in closed form, so an event is a root
of a smooth scalar function on the arc itself, not on the chord between samples. Within one step
the thrust turns by well under a quarter circle, so the distance to a line has at most one turning
point worth the name: split there, and each piece is monotone with at most one root.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array, Quadrotor

Function = Callable[[Array], tuple[Array, Array]]

ROOT_ITERATIONS = 60
ROOT_WIDTH = 1e-12
"""Width of the final bracket of a root [s]; at 20 m/s this is 2e-11 m."""


def rising_root(function: Function, low: Array, high: Array) -> Array:
    """Return the root of `function` in each bracket [low, high], shape (n,).

    Args:
        function: maps times (n,) to values (n,) and slopes (n,); below zero at `low`, at or above
            zero at `high`.
        low, high: the brackets [s], shape (n,).

    Newton's method, bisecting where Newton leaves the bracket or makes no progress; the returned
    time is the upper end of the final bracket, so the value there is not negative.
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
        # A hair beyond Newton's point, so that both ends of the bracket move.
        newton = newton + np.where(rising, -ROOT_WIDTH, ROOT_WIDTH) / 4
        inside = (newton > low) & (newton < high)
        time = np.where(inside, newton, (low + high) / 2)
    return high


class Arc:
    """The flights of n vehicles over one step: states (n, 5), controls (n, 2), durations dt (n,) [s]."""

    def __init__(self, quadrotor: Quadrotor, state: Array, control: Array, dt: Array | float) -> None:
        self.quadrotor, self.state, self.control = quadrotor, state, control
        self.dt = np.broadcast_to(np.asarray(dt, dtype=np.float64), (len(state),))

    def __getitem__(self, rows: NDArray[Any]) -> Arc:
        """Return the arcs of the vehicles picked by a mask or by their numbers."""
        return Arc(self.quadrotor, self.state[rows], self.control[rows], self.dt[rows])

    def __len__(self) -> int:
        return len(self.state)

    @property
    def reach(self) -> Array:
        """A distance that no vehicle can travel within the step [m], shape (n,); most events are ruled out by it."""
        speed = np.hypot(self.state[:, 2], self.state[:, 3])
        return speed * self.dt + (self.control[:, 0] + self.quadrotor.gravity) * self.dt**2

    def at(self, time: Array | float) -> Array:
        """Return the states `time` seconds into the step, shape (n, 5)."""
        return self.quadrotor.step(self.state, self.control, time)

    def derivative(self, state: Array) -> Array:
        """Return d(state)/dt at a state of these arcs, shape (n, 5)."""
        return self.quadrotor.derivative(state, self.control)

    def height_over(self, point: Array, direction: Array, time: Array) -> tuple[Array, Array, Array]:
        """Return (p - point) . direction with its first and second time derivative, each (n,)."""
        state = self.at(time)
        acceleration = self.derivative(state)[:, 2:4]
        return (
            np.sum((state[:, 0:2] - point) * direction, axis=-1),
            np.sum(state[:, 2:4] * direction, axis=-1),
            np.sum(acceleration * direction, axis=-1),
        )

    def turning_time(self, point: Array, direction: Array) -> Array:
        """Return when the distance over the line is extremal inside the step, else its end, (n,)."""
        start, end = np.zeros(len(self)), self.dt
        before = self.height_over(point, direction, start)[1]
        after = self.height_over(point, direction, end)[1]
        turns = before * after < 0
        time = end.copy()
        if turns.any():
            sub, sign = self[turns], np.where(before < 0, 1.0, -1.0)[turns]
            p, d = _pick(point, turns), _pick(direction, turns)

            def slope(t: Array) -> tuple[Array, Array]:
                _, first, second = sub.height_over(p, d, t)
                return sign * first, sign * second

            time[turns] = rising_root(slope, start[turns], end[turns])
        return time

    def crossing(self, point: Array, direction: Array, after: Array) -> Array:
        """Return when each path first crosses the line from below to above later than `after`.

        Args:
            point: a point of the line [m], shape (n, 2).
            direction: the unit vector of passage, across the line, shape (n, 2).
            after: times before which nothing counts [s], shape (n,).

        Returns:
            Times within the step [s], shape (n,); nan where the line is not crossed.
        """
        end = self.dt
        turn = np.clip(self.turning_time(point, direction), after, end)
        value_after, value_turn, value_end = (self.height_over(point, direction, t)[0] for t in (after, turn, end))
        first, second = (value_after < 0) & (value_turn >= 0), (value_turn < 0) & (value_end >= 0)
        found = first | second
        time = np.full(len(self), np.nan)
        if found.any():
            sub, p, d = self[found], _pick(point, found), _pick(direction, found)
            low = np.where(first, after, turn)[found]
            high = np.where(first, turn, end)[found]
            time[found] = rising_root(lambda t: sub.height_over(p, d, t)[:2], low, high)
        return time

    def lowest(self, direction: Array) -> Array:
        """Return the least p . direction over the step [m], shape (n,)."""
        origin, along = np.zeros((len(self), 2)), np.broadcast_to(direction, (len(self), 2))
        times = (np.zeros(len(self)), self.turning_time(origin, along), self.dt)
        return np.min([self.height_over(origin, along, t)[0] for t in times], axis=0)

    def distance(self, point: Array) -> Array:
        """Return the least distance to points (n, 2) over the step [m], shape (n,)."""

        def approach(arc: Arc, p: Array, t: Array) -> tuple[Array, Array, Array]:
            state = arc.at(t)
            offset, velocity = state[:, 0:2] - p, state[:, 2:4]
            slope = np.sum(offset * velocity, axis=-1)
            bend = np.sum(velocity**2 + offset * arc.derivative(state)[:, 2:4], axis=-1)
            return np.hypot(offset[:, 0], offset[:, 1]), slope, bend

        start, end = np.zeros(len(self)), self.dt
        (near_start, closing, _), (near_end, parting, _) = approach(self, point, start), approach(self, point, end)
        least = np.minimum(near_start, near_end)
        inside = (closing < 0) & (parting > 0)
        if inside.any():
            sub, p = self[inside], _pick(point, inside)
            time = rising_root(lambda t: approach(sub, p, t)[1:], start[inside], end[inside])
            least[inside] = approach(sub, p, time)[0]
        return least


def _pick(values: Array, mask: NDArray[np.bool_]) -> Array:
    return np.broadcast_to(values, (len(mask), 2))[mask]
