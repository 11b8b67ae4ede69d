"""What the outer paths of a scenario must do: lead from start to goal, through the gaps, between floor and ceiling.

A flight between outer paths is, at each s, a convex combination of their points. It passes a hoop within its gap if all
outer paths are on the hoop's line at the same s, within the gap, and it keeps floor and ceiling if all outer paths do.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.paths.corridors import Corridor
from optimal.paths.curves import Path

SAMPLES = 2000
"""Intervals of the path coordinate on which heights and crossings are searched."""
AT_END, ON_LINE, ROUNDING = 1e-8, 1e-6, 1e-9
"""Distances that count as rounding: of the ends from start and goal, from a hoop's line, and beyond gap or heights [m].
"""


def require_passage(corridor: Corridor, scenario: Scenario) -> None:
    """Refuse a corridor whose flights would miss start, goal or a hoop, or could leave floor and ceiling.

    Args:
        corridor: the outer paths, with the weights of start and goal.
        scenario: the scenario.

    Raises:
        ValueError: naming the outer path, the path coordinate s and the way out.
    """
    for s, name, weights in ((0.0, "start", corridor.ends[0]), (1.0, "goal", corridor.ends[1])):
        place = np.sum([w * path(s) for w, path in zip(weights, corridor.paths, strict=True)], axis=0)
        wanted = np.array(getattr(scenario, name))
        if not np.abs(place - wanted).max() <= AT_END:
            raise ValueError(
                f"at s = {s:g} the outer paths and their weights give {_point(place)}, but the {name} of "
                f"{scenario.name!r} is {_point(wanted)}; change the weights `ends`, or the outer paths"
            )
    for i, path in enumerate(corridor.paths):
        _require_heights(path, i, scenario)
    after = 0.0
    for i, hoop in enumerate(scenario.hoops):
        after = _passage(corridor, hoop, f"hoops[{i}]", scenario.quadrotor.radius, after)


def _require_heights(path: Path, index: int, scenario: Scenario) -> None:
    """Refuse an outer path that leaves the heights between floor and ceiling."""
    s = np.linspace(0.0, 1.0, SAMPLES + 1)
    height, (low, high) = path(s)[:, 1], scenario.heights
    for beyond, name, limit in ((low - height, "floor", low), (height - high, "ceiling", high)):
        worst = int(np.argmax(beyond))
        if beyond[worst] > ROUNDING:
            raise ValueError(
                f"outer path {index} crosses the {name} at s = {s[worst]:.4g}: it is at z = {height[worst]:.6g} m, "
                f"and the {name}, for the vehicle's centre, at {limit:.6g} m; move the path, or the {name}"
            )


def _passage(corridor: Corridor, hoop: Hoop, name: str, radius: float, after: float) -> float:
    """Return the first path coordinate after another at which all outer paths pass a hoop within its gap."""
    half, refused = hoop.half_gap(radius), ""
    least = np.inf
    for s in _crossings(corridor.paths[0], hoop, after):
        offsets = np.array([path(s) for path in corridor.paths]) - hoop.centre
        along, aside = np.abs(offsets @ hoop.direction), np.abs(offsets @ hoop.across)
        if along.max() <= ON_LINE and aside.max() <= half + ROUNDING:
            return s
        excess = np.maximum(along - ON_LINE, np.maximum(aside - half, 0.0))
        if excess.max() < least:
            worst, least = int(np.argmax(excess)), float(excess.max())
            refused = (
                f"outer path {worst} leaves the gap of {name} at s = {s:.4g}: it is {along[worst]:.4g} m from the "
                f"hoop's line and {aside[worst]:.4g} m aside from its centre, of at most {half:.4g} m"
            )
    if not refused:
        refused = f"outer path 0 does not cross {name}, {hoop}, in its direction between s = {after:.4g} and s = 1"
    raise ValueError(f"{refused}; all outer paths must pass a hoop at the same s, within its gap (section II-D)")


def _crossings(path: Path, hoop: Hoop, after: float) -> list[float]:
    """Return the path coordinates after another at which a path crosses a hoop's line in its direction."""

    def along(s: float) -> float:
        return float((path(s) - hoop.centre) @ hoop.direction)

    s = np.linspace(after, 1.0, SAMPLES + 1)
    ahead = (path(s) - hoop.centre) @ hoop.direction
    found = np.flatnonzero((ahead[:-1] < 0) & (ahead[1:] >= 0))
    return [brentq(along, s[i], s[i + 1], xtol=1e-15) for i in found]


def _point(place: Array) -> str:
    return f"({', '.join(f'{value:.6g}' for value in place)}) m"
