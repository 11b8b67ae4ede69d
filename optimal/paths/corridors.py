"""Corridors: outer paths y_1, ..., y_k between which a flight is planned, section II-D.

A flight y(s) = sum p_i(s) y_i(s) with sum p_i = 1 and p_i >= 0 stays in the convex hull of the outer paths at every s,
for any weights. Geometric constraints are therefore satisfied before the optimisation begins. The paper constructs its
corridors by hand (`paper_corridor`). `corridor` constructs them for any scenario (`optimal.paths.outer_paths`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.paths.curves import Path, PolynomialPath, smoothstep
from optimal.paths.outer_paths import outer_paths
from optimal.paths.regularity import require_regular

_PRINTED = ((5.0, 5.0), (2.5, 2.5, 0.5, 0.0))
"""The only hoop flight of the paper: displacement; x, z, diameter and angle of the hoop, relative to the start."""


@dataclass(frozen=True, eq=False)
class Corridor:
    """Outer paths, and the weights of start and goal.

    Attributes:
        paths: the outer paths y_1, ..., y_k, at rest (y' = 0) at both ends.
        ends: the weights p_1, ..., p_k of start (s = 0) and goal (s = 1), shape (2, k).

    Raises:
        ValueError: for fewer than two paths, or ends that are not weights.
    """

    paths: tuple[Path, ...]
    ends: Array

    def __post_init__(self) -> None:
        ends = np.array(self.ends, dtype=np.float64)
        if len(self.paths) < 2:
            raise ValueError(f"a corridor needs at least two outer paths, got {len(self.paths)}")
        if ends.shape != (2, len(self.paths)):
            raise ValueError(f"ends must have shape (2, {len(self.paths)}), a weight for each path, got {ends.shape}")
        if not ((ends >= 0).all() and np.abs(ends.sum(axis=1) - 1).max() <= 1e-9):
            raise ValueError(f"ends must be weights: at least 0, and 1 in sum at each end, got {ends.tolist()}")
        object.__setattr__(self, "ends", ends)

    @property
    def central(self) -> Path:
        """The central path, section II-E: its weights blend smoothly from those of the start to those of the goal."""
        return _Blend(self)


@dataclass(frozen=True, eq=False)
class _Blend:
    """The path sum p_i(s) y_i(s) of a corridor, with weights blended by the smoothstep q(s) of section III."""

    corridor: Corridor

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        s = np.asarray(s, dtype=np.float64)
        (first, last), rise = self.corridor.ends, smoothstep(3)
        position = np.zeros(())
        for k in range(order + 1):
            share = rise.deriv(k)(s)[..., None]
            weights = (1 - share) * first + share * last if k == 0 else share * (last - first)
            outer = np.stack([path(s, order - k) for path in self.corridor.paths], axis=-2)
            position = position + math.comb(order, k) * (weights[..., None] * outer).sum(axis=-2)
        return position


def end_weights(paths: tuple[Path, ...], start: ArrayLike, goal: ArrayLike) -> Array:
    """Return the weights of the outer paths at s = 0 and 1 that give start and goal, shape (2, k).

    Args:
        paths: k outer paths.
        start, goal: points, shape (n,).

    Raises:
        ValueError: for a point that does not lie between the paths.
    """
    return np.stack([_weights(paths, 0.0, start), _weights(paths, 1.0, goal)])


def _weights(paths: tuple[Path, ...], s: float, point: ArrayLike) -> Array:
    """Return the weights of the outer paths at s that give a point, shape (k,)."""
    # The least-norm solution is the most central one.
    hull = np.stack([np.append(path(s), 1.0) for path in paths], axis=1)
    target = np.append(np.asarray(point, dtype=np.float64), 1.0)
    weights = np.linalg.lstsq(hull, target, rcond=None)[0]
    if np.abs(hull @ weights - target).max() > 1e-9 or weights.min() < -1e-9:
        raise ValueError(f"the point {tuple(target[:-1].tolist())} does not lie between the outer paths at s = {s:g}")
    weights = np.where(weights < 1e-12, 0.0, weights)
    return weights / weights.sum()


def corridor(scenario: Scenario, count: int = 2) -> Corridor:
    """Return outer paths through all hoops of a scenario, within floor and ceiling everywhere.

    Args:
        scenario: the scenario. The radius of the vehicle reduces the gaps, and a vehicle with a radius passes them in a
            straight line.
        count: 2 for a rib across the centre line, 4 for a box along it. A box covers more flights, but the same motion
            can be represented by many combinations of b and weights, which is hard for solvers.

    Returns:
        The corridor. Its paths are four times continuously differentiable, with y' = y'' = 0 at both ends.

    Raises:
        ValueError: for another count, or if no corridor exists, with the reason.

    Source: section II-D, which constructs corridors by hand.
    """
    if count not in (2, 4):
        raise ValueError(f"count of outer paths must be 2 (a rib) or 4 (a box), got {count}")
    paths = outer_paths(scenario, count)
    result = Corridor(paths, end_weights(paths, scenario.start, scenario.goal))
    _require_central(scenario, result)
    return result


def _require_central(scenario: Scenario, result: Corridor) -> None:
    """Refuse a corridor whose central path stands still between its ends."""
    try:
        require_regular(result.central)
    except ValueError as error:
        raise ValueError(
            f"no corridor for {scenario.name!r}: between floor {scenario.floor} and ceiling {scenario.ceiling} there "
            f"is no room to turn between its hoops ({error})"
        ) from error


def paper_corridor(scenario: Scenario) -> Corridor:
    """Return the outer paths the paper prints for a scenario, sections III-A and III-B.

    Their heights are, above x = x_T q(s),

        horizontal   -1                          and  +1                            (c = 1)
        ground        0                          and  +1
        general      -c                          and  z_T + c
        hoop         (x_T r(s) - 2.5)^2 + 2.75   and  -(x_T r(s) - 2.5)^2 + 2.25.

    Misprint corrected: the paper prints the lower hoop path with -2.25, which lies 5 m below the hoop. With +2.25 the
    two paths are 0.5 m apart at x = 2.5 m, which is the hoop. The constant c is 0 m for (5, 5) m, as printed, and 1 m
    otherwise. Floor and ceiling cut the corridor.

    Args:
        scenario: a horizontal, ground or general displacement without hoops, or the paper's hoop.

    Raises:
        ValueError: for a scenario without printed paths, with the reason.
    """
    if reason := _unprinted(scenario):
        raise ValueError(
            f"the paper prints no outer paths for {scenario.name!r}: {reason}; use `optimal.corridor` instead"
        )
    start, goal = np.array(scenario.start), np.array(scenario.goal)
    advance, climb = (goal - start).tolist()
    if scenario.hoops:
        bow = (5.0 * smoothstep(2) - 2.5) ** 2
        heights = (bow + 2.75 + start[1], -bow + 2.25 + start[1])
    else:
        c = 0.0 if (advance, climb) == _PRINTED[0] else 1.0
        ends = np.clip(start[1] + np.array([min(climb, 0.0) - c, max(climb, 0.0) + c]), *scenario.heights)
        heights = (Polynomial([ends[0]]), Polynomial([ends[1]]))
    x = advance * smoothstep(3) + start[0]
    paths = tuple(PolynomialPath((tuple(x.coef), tuple(z.coef))) for z in heights)
    return Corridor(paths, end_weights(paths, start, goal))


def is_printed(scenario: Scenario) -> bool:
    """Return whether the paper prints outer paths for a scenario."""
    return not _unprinted(scenario)


def _unprinted(scenario: Scenario) -> str:
    """Return why the paper prints no outer paths for a scenario; empty if it does."""
    start, goal = scenario.start, scenario.goal
    displacement = (goal[0] - start[0], goal[1] - start[1])
    if not scenario.hoops:
        vertical = "its flight is vertical, and x = x_T q(s) would leave no room to tilt"
        return vertical if displacement[0] == 0 else ""
    hoops = tuple((h.x - start[0], h.z - start[1], h.diameter, h.angle) for h in scenario.hoops)
    narrower = scenario.floor is not None or scenario.ceiling is not None or scenario.quadrotor.radius > 0
    if (displacement, *hoops) == _PRINTED and not narrower:
        return ""
    return (
        "its only hoop flight is (5, 5) m through one hoop of 0.5 m at (2.5, 2.5) m by a point without floor or "
        f"ceiling; this one is {displacement} m through {len(hoops)} hoop(s)"
    )
