"""The outer paths the paper prints, sections III-A and III-B: polynomials in the path coordinate.

A flight is a convex combination of outer paths, y(s) = sum p_i(s) y_i(s) with s in [0, 1], and
stays between them whatever the weights. The printed pairs share their x-coordinate x_T q(s),

    q(s) = s^5 + 5 s^4 (1 - s) + 10 s^3 (1 - s)^2,   q' = q'' = 0 at both ends,
    r(s) = s^3 + 3 s^2 (1 - s),                      r' = 0 at both ends,

so that x-velocity and x-acceleration vanish at both ends by construction. Their heights are

    horizontal   -1                          and  +1                            (c = 1)
    ground        0                          and  +1
    general      -c                          and  z_T + c
    hoop         (x_T r(s) - 2.5)^2 + 2.75   and  -(x_T r(s) - 2.5)^2 + 2.25.

Misprint corrected: the paper prints the lower hoop path with -2.25, which lies 5 m below the
hoop; with +2.25 the two paths are 0.5 m apart at x = 2.5 m, which is the hoop.

A path answers `path(s, order)`: its derivative of that order with respect to s, shape (..., 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from flatgym.quadrotor import Array
from flatgym.scenario import Scenario


class Path(Protocol):
    """Whatever answers `path(s, order)` with positions and their exact derivatives, shape (..., 2)."""

    def __call__(self, s: ArrayLike, order: int = 0) -> Array: ...


OuterPaths = tuple[Path, Path]
"""The two paths a flight stays between."""


class PaperPaths(NamedTuple):
    """Outer paths with the weights (p_1(0), p_1(1)) of the first path, where a flight begins and ends."""

    paths: OuterPaths
    ends: tuple[float, float]


_Q = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
_R = Polynomial([0.0, 0.0, 3.0, -2.0])

_HOOP = ((5.0, 5.0), (2.5, 2.5, 0.5, 0.0))
"""The one hoop flight the paper prints: displacement; hoop x, z, diameter, angle, from the start."""


@dataclass(frozen=True)
class PolynomialPath:
    """A path whose coordinates are polynomials of s.

    Attributes:
        x, z: coefficients [m], constant first.
    """

    x: tuple[float, ...]
    z: tuple[float, ...]

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Return the derivative of the given order with respect to s, exactly.

        Args:
            s: path coordinates, shape (...).
            order: 0 for the position, 1 for the first derivative, and so on.

        Returns:
            The coordinates [m], shape (..., 2).

        Raises:
            ValueError: for a negative order.
        """
        if order < 0:
            raise ValueError(f"order of a derivative must be at least 0, got {order}")
        s = np.asarray(s, dtype=np.float64)
        return np.stack([Polynomial(c).deriv(order)(s) + 0 * s for c in (self.x, self.z)], axis=-1)


def _path(x: Polynomial, z: Polynomial) -> PolynomialPath:
    return PolynomialPath(tuple(map(float, x.coef)), tuple(map(float, z.coef)))


def level_paths(start: ArrayLike, x_distance: float, low: float, high: float) -> OuterPaths:
    """Return the paths at two constant heights, advancing by x_distance q(s).

    Args:
        start: where x begins, (x, z) [m].
        x_distance: displacement along x [m], of either sign but not 0.
        low, high: the two heights [m].

    Returns:
        The lower and the upper path.

    Raises:
        ValueError: where the paths are not regular curves or enclose nothing.

    Source: sections III-A and III-B, horizontal, ground and general displacement.
    """
    if x_distance == 0:
        raise ValueError(
            "x_distance is 0, but the printed paths advance as x_T q(s) and must not stand still: "
            "give the flight sideways room with outer paths of your own, or use another method"
        )
    if not low < high:
        raise ValueError(f"the lower path must lie below the upper one, got heights {low} and {high} m")
    x = _Q * x_distance + float(np.asarray(start)[0])
    return _path(x, Polynomial([low])), _path(x, Polynomial([high]))


def hoop_paths(start: ArrayLike = (0.0, 0.0)) -> OuterPaths:
    """Return the corridor through the paper's hoop, upper path first as printed.

    Args:
        start: where the flight of (5, 5) m begins, (x, z) [m]; the hoop's centre is at the middle.

    Source: section III-B, with the misprinted -2.25 corrected to +2.25.
    """
    x_start, z_start = map(float, np.asarray(start))
    x, bow = _Q * 5.0 + x_start, (_R * 5.0 - 2.5) ** 2
    return _path(x, bow + 2.75 + z_start), _path(x, -bow + 2.25 + z_start)


def end_weights(paths: OuterPaths, start: ArrayLike, goal: ArrayLike) -> tuple[float, float]:
    """Return p_1(0) and p_1(1), the weights of the first path that begin at start and end at goal.

    Args:
        paths: two outer paths that agree in x.
        start, goal: points (x, z) [m].

    Raises:
        ValueError: where a point does not lie between the paths.
    """
    weights = []
    for s, point in ((0.0, np.asarray(start)), (1.0, np.asarray(goal))):
        first, second = paths[0](s), paths[1](s)
        weight = float((point - second)[1] / (first - second)[1])
        miss = float(np.abs(second + weight * (first - second) - point).max())
        if miss > 1e-9 or not 0 <= weight <= 1:
            raise ValueError(f"the point {tuple(point)} does not lie between the outer paths at s = {s:g}")
        weights.append(weight + 0.0)
    return weights[0], weights[1]


def paper_outer_paths(scenario: Scenario) -> PaperPaths:
    """Return the outer paths the paper prints for a scenario, and p_1 at both ends.

    The constant c of the general displacement is 0 m for (5, 5) m, as printed, and otherwise 1 m,
    as in the horizontal flights; floor and ceiling cut the corridor, which gives the ground paths.

    Args:
        scenario: horizontal, ground or general displacement without hoops, or the paper's hoop.

    Returns:
        The two paths, and the weights (p_1(0), p_1(1)) of the first.

    Raises:
        ValueError: for a scenario the paper prints no paths for, saying why.
    """
    start, goal = np.array(scenario.start), np.array(scenario.goal)
    x_distance, climb = (goal - start).tolist()
    if scenario.hoops:
        paths = _paths_through_hoops(scenario)
    elif x_distance == 0:
        raise ValueError(
            f"the paper prints no outer paths for {scenario.name!r}: its flight is vertical, and x = x_T q(s) "
            "would leave no room to tilt; give optimal.plan outer paths of your own, or use another method"
        )
    else:
        c = 0.0 if (x_distance, climb) == _HOOP[0] else 1.0
        low, high = scenario.start[1] + min(climb, 0.0) - c, scenario.start[1] + max(climb, 0.0) + c
        low = low if scenario.floor is None else max(low, scenario.floor)
        high = high if scenario.ceiling is None else min(high, scenario.ceiling)
        paths = level_paths(start, x_distance, low, high)
    return PaperPaths(paths, end_weights(paths, start, goal))


def _paths_through_hoops(scenario: Scenario) -> OuterPaths:
    start, goal = scenario.start, scenario.goal
    hoops = tuple((h.x - start[0], h.z - start[1], h.diameter, h.angle) for h in scenario.hoops)
    displacement = (goal[0] - start[0], goal[1] - start[1])
    narrower = scenario.floor is not None or scenario.ceiling is not None or scenario.quadrotor.radius > 0
    if (displacement, *hoops) != _HOOP or narrower:
        raise ValueError(
            f"the paper prints no outer paths for {scenario.name!r}: its only hoop flight is (5, 5) m through one "
            f"hoop of 0.5 m at (2.5, 2.5) m by a point without floor or ceiling; this one is {displacement} m through "
            f"{len(hoops)} hoop(s). Give optimal.plan outer paths of your own, or use another method"
        )
    return hoop_paths(start)
