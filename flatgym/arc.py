"""Events within one step: line crossings, lowest points and closest approaches on the exact arc.

Under a constant control the position within a step is known in closed form. An event is a root of a smooth scalar
function on the arc itself, not on the chord between samples.

For the distance to a line with normal n, the intervals on which it is monotone are known too. Its second derivative

    n . p'' = f cos(theta - beta) + n . c,   beta the tilt at which thrust points along n,

with c the acceleration by gravity and wind, is zero at theta = beta +- arccos(-n . c / f). Between these tilts the
velocity along n is monotone and has at most one root. Between those roots the distance is monotone.

The arrays may be those of NumPy, PyTorch or JAX (`flatgym.arrays`). No search writes into an array or branches on a
value, and each has a bounded length.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from flatgym.arrays import constant, hypot, library, like, namespace, repeat
from flatgym.quadrotor import Quadrotor, exact_step

Function = Callable[[Any], tuple[Any, Any]]

ROOT_ITERATIONS = 60
"""Maximum number of Newton or bisection iterations."""
ROOT_WIDTH = 1e-12
"""Width of the final bracket of a root [s]; at 20 m/s this is 2e-11 m. In single precision a few roundings."""
SAGITTA_TOLERANCE = 1e-10
"""Sagitta below which a part of an arc is not divided further [m]. In single precision a few roundings of 1 m."""


def rising_root(function: Function, low: Any, high: Any) -> Any:
    """Return the root of `function` in each bracket [low, high], shape (...).

    Args:
        function: maps times (...) to values and slopes; negative at `low`, nonnegative at `high`.
        low, high: the brackets [s], shape (...).

    Newton's method, with bisection where it leaves the bracket. The result is the upper end of the final bracket, so
    the value there is not negative. A bracket as narrow as ROOT_WIDTH does not change any more.
    """
    xp = namespace(low, high)
    width = xp.maximum(4 * xp.finfo(high.dtype).eps * high, xp.full_like(high, ROOT_WIDTH))

    def goes_on(low: Any, high: Any, _: Any, count: Any) -> Any:
        return xp.any(high - low > width) & (count < ROOT_ITERATIONS)

    def narrow(low: Any, high: Any, time: Any, count: Any) -> tuple[Any, ...]:
        value, slope = function(time)
        wide, rising = high - low > width, value >= 0
        high = xp.where(wide & rising, time, high)
        low = xp.where(wide & ~rising, time, low)
        flat = slope == 0
        # Slightly beyond Newton's point, so that both ends of the bracket move.
        beyond = xp.where(rising, -width, width) / 4
        newton = time - value / xp.where(flat, xp.ones_like(slope), slope) + beyond
        inside = ~flat & (newton > low) & (newton < high)
        return low, high, xp.where(inside, newton, (low + high) / 2), count + 1

    count = xp.zeros((), **(like(low) | {"dtype": xp.int32}))
    return repeat(goes_on, narrow, low, high, (low + high) / 2, count)[1]


class Arc:
    """The paths of n vehicles over one step.

    Args:
        quadrotor: the vehicle.
        state: states at the beginning of the step, shape (n, 5).
        control: constant controls [thrust, rate], shape (n, 2).
        dt: duration of the step [s], a number or shape (n,).
        wind: constant acceleration in addition to gravity [m/s^2], shape (n, 2) or (2,).
    """

    def __init__(self, quadrotor: Quadrotor, state: Any, control: Any, dt: Any, wind: Any = 0.0) -> None:
        xp = self.xp = namespace(state, control)
        self.quadrotor, self.state, self.control, n = quadrotor, state, control, state.shape[0]
        self.dt = xp.broadcast_to(xp.asarray(dt, **like(state)), (n,))
        self.wind = xp.broadcast_to(xp.asarray(wind, **like(state)), (n, 2))

    def __getitem__(self, rows: Any) -> Arc:
        """Return the arcs of the vehicles selected by a mask or by indices."""
        return Arc(self.quadrotor, self.state[rows], self.control[rows], self.dt[rows], self.wind[rows])

    def __len__(self) -> int:
        return int(self.state.shape[0])

    @property
    def arrays(self) -> tuple[Any, ...]:
        """State, control, dt and wind; `Arc(quadrotor, *arrays)` is the inverse."""
        return self.state, self.control, self.dt, self.wind

    @property
    def constant(self) -> Arc:
        """The same arcs, through which no gradient flows."""
        return Arc(self.quadrotor, *(constant(array) for array in self.arrays))

    @property
    def reach(self) -> Any:
        """A bound of the distance travelled within the step [m], shape (n,); it rules out most events."""
        speed = hypot(self.state[:, 2], self.state[:, 3])
        return speed * self.dt + self.acceleration_bound * self.dt**2

    @property
    def pull(self) -> tuple[Any, Any]:
        """The constant acceleration along x and z by gravity and wind [m/s^2], each shape (n,)."""
        return self.wind[:, 0], self.wind[:, 1] - self.quadrotor.gravity

    @property
    def acceleration_bound(self) -> Any:
        """A bound of |p''| [m/s^2], shape (n,)."""
        return self.control[:, 0] + hypot(*self.pull)

    def components(self, time: Any) -> tuple[Any, ...]:
        """Return x, z, vx, vz and theta at times of shape (..., n), each of that shape."""
        state, control = self.state, self.control
        x, z, vx, vz, theta = exact_step(
            tuple(state[:, i] for i in range(5)), (control[:, 0], control[:, 1]), time, self.quadrotor.gravity, self.xp
        )
        blown_x, blown_z = time * self.wind[:, 0], time * self.wind[:, 1]
        return x + blown_x * time / 2, z + blown_z * time / 2, vx + blown_x, vz + blown_z, theta

    def at(self, time: Any) -> Any:
        """Return the states `time` seconds into the step, a number or shape (n,); shape (n, 5)."""
        return self.xp.stack(self.components(time), axis=-1)

    def acceleration(self, theta: Any) -> tuple[Any, Any]:
        """Return the acceleration along x and z at tilts of shape (..., n) [m/s^2]."""
        thrust, (pull_x, pull_z) = self.control[:, 0], self.pull
        return thrust * self.xp.sin(theta) + pull_x, thrust * self.xp.cos(theta) + pull_z

    def inflections(self, direction: Any) -> tuple[Any, Any]:
        """Return the two times at which p'' . direction is zero, in order; dt where there is none [s], each (n,).

        Each of the two tilts occurs at most once, because a scenario's dt excludes a whole turn within a step.
        """
        xp, thrust, rate, theta = self.xp, self.control[:, 0], self.control[:, 1], self.state[:, 4]
        along_x, along_z = direction[..., 0], direction[..., 1]
        pull_x, pull_z = self.pull
        least = 1e8 * float(xp.finfo(thrust.dtype).smallest_normal)  # no overflow by a division by zero
        ratio = -(pull_x * along_x + pull_z * along_z) / xp.clip(thrust, least, None)
        beta, spread = xp.atan2(along_x, along_z), xp.acos(xp.clip(ratio, -1.0, 1.0))
        none = (xp.abs(ratio) > 1) | (rate == 0)
        speed = xp.where(rate == 0, xp.ones_like(rate), xp.abs(rate))
        times = []
        for tilt in (beta - spread, beta + spread):
            time = xp.remainder(xp.sign(rate) * (tilt - theta), xp.full_like(theta, 2 * np.pi)) / speed
            times.append(xp.where(none, self.dt, xp.minimum(time, self.dt)))
        return xp.minimum(*times), xp.maximum(*times)

    def height_over(self, point: Any, direction: Any, time: Any) -> tuple[Any, Any]:
        """Return (p - point) . direction [m] and its time derivative at times of shape (..., n)."""
        x, z, vx, vz, _ = self.components(time)
        along_x, along_z = direction[..., 0], direction[..., 1]
        height = (x - point[..., 0]) * along_x + (z - point[..., 1]) * along_z
        return height, vx * along_x + vz * along_z

    def speed_along(self, direction: Any, time: Any) -> tuple[Any, Any]:
        """Return p' . direction [m/s] and its time derivative at times of shape (..., n)."""
        _, _, vx, vz, theta = self.components(time)
        ax, az = self.acceleration(theta)
        along_x, along_z = direction[..., 0], direction[..., 1]
        return vx * along_x + vz * along_z, ax * along_x + az * along_z

    def approach(self, point: Any, time: Any) -> tuple[Any, Any]:
        """Return half the rate of change of |p - point|^2 [m^2/s] and its time derivative at times (..., n)."""
        x, z, vx, vz, theta = self.components(time)
        ax, az = self.acceleration(theta)
        x, z = x - point[..., 0], z - point[..., 1]
        return x * vx + z * vz, vx**2 + vz**2 + x * ax + z * az

    def monotone_times(self, direction: Any) -> Any:
        """Return five times from 0 to dt; between two of them p . direction is monotone [s], shape (5, n)."""
        xp, start = self.xp, self.xp.zeros_like(self.dt)
        knots = xp.stack([start, *self.inflections(direction), self.dt])
        slopes = self.speed_along(direction, knots)[0]
        low, high, after = knots[:-1], knots[1:], slopes[1:]
        turns, sign = slopes[:-1] * after < 0, xp.sign(after)

        def rising(time: Any) -> tuple[Any, Any]:
            speed, slope = self.speed_along(direction, time)
            return sign * speed, sign * slope

        times = rising_root(rising, xp.where(turns, low, high), high)
        return xp.concat([start[None], times, self.dt[None]])

    def crossing(self, point: Any, direction: Any, after: Any) -> Any:
        """Return the first time later than `after` at which each path crosses a line from below to above.

        Args:
            point: a point of the line [m], shape (n, 2).
            direction: the unit normal of the line, in the direction of passage, shape (n, 2).
            after: times before which crossings do not count [s], shape (n,).

        Returns:
            Times within the step [s], shape (n,); nan without a crossing. Their gradients are those of the implicit
            function theorem, dt = -dh / h' with h the height over the line; a crossing along the line has none.
        """
        xp, arc = self.xp, self.constant
        times = xp.maximum(arc.monotone_times(direction), after)
        heights = arc.height_over(point, direction, times)[0]
        rises = (heights[:-1] < 0) & (heights[1:] >= 0)
        # Brackets without a crossing are empty. The first one with a crossing is taken.
        low, high = xp.zeros_like(self.dt), xp.zeros_like(self.dt)
        for i in (3, 2, 1, 0):
            low, high = xp.where(rises[i], times[i], low), xp.where(rises[i], times[i + 1], high)
        found = rising_root(partial(arc.height_over, point, direction), low, high)
        if library(found) != "numpy":
            height, speed = self.height_over(point, direction, found)
            speed = constant(xp.where(speed == 0, xp.ones_like(speed), speed))
            found = found - (height - constant(height)) / speed
        return xp.where(xp.any(rises, axis=0), found, xp.nan)

    def lowest(self, direction: Any) -> Any:
        """Return the minimum of p . direction over the step [m], for vectors of shape (2,) or (n, 2); shape (n,)."""
        xp = self.xp
        along = xp.broadcast_to(xp.asarray(direction, **like(self.state)), (len(self), 2))
        times = self.monotone_times(along)
        return xp.min(self.height_over(xp.zeros_like(along), along, times)[0], axis=0)

    def distance(self, point: Any, within: float = np.inf) -> Any:
        """Return a proven lower bound of the distance to points over the step [m], shape (..., n), tight to 1e-9.

        Let r = |p - point|^2 / 2 and c the acceleration by gravity and wind. On a part of the step |p'''| <= f |omega|,
        and |p''| is at most f + |c| and at most its initial value plus f |omega| times the length of the part. This
        bounds r'''. A part on which r is shown to be monotone or convex has its minimum at an end or at the root of
        r'. A part whose chord distance minus the sagitta bound exceeds the minimum so far is passed over. Any other
        part is halved; after a part that is settled, the next one is twice as long.

        Args:
            point: shape (..., n, 2) [m].
            within: distances from this value on need not be resolved; any value >= `within` stands for them [m].
        """
        xp, dt = self.xp, self.dt
        fine = max(SAGITTA_TOLERANCE, 4 * xp.finfo(dt.dtype).eps)

        def settle(low: Any, width: Any, least: Any) -> tuple[Any, ...]:
            high = xp.minimum(low + width, dt)
            before, after, most = self._approach_bounds(point, low, high)
            least = xp.minimum(least, hypot(*after[0]))
            sagitta = most * (high - low) ** 2 / 8
            floor = _chord_distance(xp, before[0], after[0]) - sagitta
            rising = (xp.minimum(before[1], after[1]) >= after[3]) | (xp.maximum(before[1], after[1]) <= -after[3])
            convex = xp.minimum(before[2], after[2]) >= before[3]
            turns = (low < dt) & convex & ~rising & (before[1] < 0) & (after[1] > 0) & (floor < least)
            time = rising_root(partial(self.approach, point), xp.where(turns, low, high), high)
            least = xp.where(turns, xp.minimum(least, self._distance_at(point, time)), least)
            # Parts with a tiny sagitta count with their lower bound.
            unsettled = ~(rising | convex) & (floor < xp.clip(least, None, within))
            tiny = unsettled & (sagitta <= fine)
            least = xp.where(tiny, xp.minimum(least, floor), least)
            divide = unsettled & ~tiny
            return xp.where(divide, low, high), xp.where(divide, (high - low) / 2, 2 * width), least

        least = xp.minimum(self._distance_at(point, xp.zeros_like(dt)), self._distance_at(point, dt))
        width = xp.zeros_like(least) + dt
        return xp.clip(
            repeat(lambda *now: xp.any(now[0] < dt), settle, xp.zeros_like(least), width, least)[2], 0.0, None
        )

    def _approach_bounds(self, point: Any, low: Any, high: Any) -> Any:
        """Return (offset, r', r'', error bound) at both ends of parts [low, high], and a bound of |p''|.

        See `distance` for r. The first error bound is how far r'' may fall below its smaller end value, the second how
        far r' may deviate from its chord.
        """
        xp, width, jerk = self.xp, high - low, self.control[:, 0] * self.xp.abs(self.control[:, 1])
        found = []
        for time in (low, high):
            x, z, vx, vz, theta = self.components(time)
            ax, az = self.acceleration(theta)
            x, z = x - point[..., 0], z - point[..., 1]
            found.append(((x, z), x * vx + z * vz, vx**2 + vz**2 + x * ax + z * az))
            if time is low:
                # A hovering vehicle has almost no acceleration; this bound then ends the bisection early.
                pull = xp.minimum(self.acceleration_bound, hypot(ax, az) + jerk * width)
                speed = hypot(vx, vz) + pull * width
                away = hypot(x, z) + speed * width
        third = 3 * speed * pull + away * jerk
        return (*found[0], third * width / 2), (*found[1], third * width**2 / 8), pull

    def _distance_at(self, point: Any, time: Any) -> Any:
        """Return the distances to points at times, shape (..., n)."""
        x, z = self.components(time)[:2]
        return hypot(x - point[..., 0], z - point[..., 1])


def _chord_distance(xp: Any, before: tuple[Any, Any], after: tuple[Any, Any]) -> Any:
    """Return the distances of the origin to segments between points, shape (..., n)."""
    (x, z), (to_x, to_z) = before, after
    chord_x, chord_z = to_x - x, to_z - z
    length = chord_x**2 + chord_z**2
    share = xp.clip(-(x * chord_x + z * chord_z) / xp.where(length > 0, length, xp.ones_like(length)), 0.0, 1.0)
    return hypot(x + share * chord_x, z + share * chord_z)
