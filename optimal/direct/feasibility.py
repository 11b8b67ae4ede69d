"""Why there is no flight: what can be shown before the solve, and whom to suspect after it.

Before: the places where the vehicle's centre may pass a hoop are its gap, less the radius at both
ends, less what lies below the floor or above the ceiling, less the discs of that radius about the
rims of the other hoops. Where nothing is left, no flight exists. (A vehicle that cannot hover and
a hoop that lies wholly outside the heights are refused by `Scenario` itself.)

After: where the solver finds nothing, it is asked again with one requirement left out at a time. The
first whose absence lets it converge stands in the way - of the solver at least, which is no proof.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from flatgym.scenarios.scenario import Scenario
from optimal.direct.program import LONGEST
from optimal.direct.shooting import solve_coarse
from optimal.flights.projection_bound import projection_bound

Interval = tuple[float, float]

TOUCH = 1e-9
"""A passage narrower than this between two rims [m] is none: the body would touch both."""


def impossible(scenario: Scenario) -> str:
    """Return why no flight of a scenario can exist, naming the limit at fault; empty where none is known."""
    for i, hoop in enumerate(scenario.hoops):
        name, (low, high) = f"hoops[{i}]", scenario.heights
        if abs(math.cos(hoop.angle)) < 1e-9 and not low < hoop.z < high:
            return (
                f"{name} lies flat at z = {hoop.z} m, against the {'floor' if hoop.z <= low else 'ceiling'}, and "
                "cannot be passed from one side to the other; move it inside."
            )
        if not passage(scenario, i):
            return (
                f"{name} cannot be passed: floor, ceiling and the rims of the other hoops leave nothing of its gap of "
                f"{hoop.diameter} m for a body of radius {scenario.quadrotor.radius} m; widen or move it."
            )
    return ""


def passage(scenario: Scenario, index: int) -> list[Interval]:
    """Return where on the line of a hoop the vehicle's centre may pass, as intervals from its centre [m].

    Args:
        scenario: the task.
        index: of the hoop.
    """
    hoop, radius = scenario.hoops[index], scenario.quadrotor.radius
    half = hoop.half_gap(radius)
    low, high, slope = -half, half, hoop.across[1]
    if abs(slope) > 1e-9:
        ends = sorted((height - hoop.z) / slope for height in scenario.heights)
        low, high = max(low, ends[0]), min(high, ends[1])
    free = [(low, high)] if low <= high else []
    for other in scenario.hoops if radius > 0 else ():
        for side in (-0.5, 0.5):
            offset = other.centre + side * other.diameter * other.across - hoop.centre
            reach = math.sqrt(max(0.0, radius**2 - float(offset @ hoop.direction) ** 2))
            middle = float(offset @ hoop.across)
            pieces = [piece for a, b in free for piece in ((a, min(b, middle - reach)), (max(a, middle + reach), b))]
            free = [(a, b) for a, b in pieces if a < b - TOUCH] if reach > 0 else free
    return free


def beyond_horizon(scenario: Scenario) -> str:
    """Return why the goal is beyond the longest flight the solver considers; empty where it is not."""
    least, longest = projection_bound(scenario), LONGEST * (len(scenario.hoops) + 1)
    if least <= longest:
        return ""
    return (
        f"The goal is too far: any flight takes at least {least:.4g} s, and the solver considers {longest:g} s at "
        "most; bring it nearer or give more thrust."
    )


def suspect(scenario: Scenario) -> str:
    """Return what seems to keep the solver from a flight, found by leaving out one requirement at a time."""
    for words, easier in relaxations(scenario):
        if solve_coarse(easier).converged:
            return f"The optimiser finds a flight {words}; look there."
    return "The optimiser finds no flight even without hoops and heights; look at goal and thrust_max."


def relaxations(scenario: Scenario) -> Iterator[tuple[str, Scenario]]:
    """Yield the scenario with one requirement less, and words for it."""
    if scenario.floor is not None:
        yield f"without the floor at {scenario.floor} m", replace(scenario, floor=None)
    if scenario.ceiling is not None:
        yield f"without the ceiling at {scenario.ceiling} m", replace(scenario, ceiling=None)
    for i, hoop in enumerate(scenario.hoops):
        rest = scenario.hoops[:i] + scenario.hoops[i + 1 :]
        yield f"without hoops[{i}] = {hoop}", replace(scenario, hoops=rest)
    if scenario.hoops and scenario.quadrotor.radius > 0:
        point = replace(scenario, quadrotor=replace(scenario.quadrotor, radius=0.0))
        yield f"for a point instead of a body of radius {scenario.quadrotor.radius} m", point
