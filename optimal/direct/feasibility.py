"""Infeasibility: proofs before the solve, and a diagnosis after a failed solve.

Proof: the vehicle's centre can pass a hoop in its gap, less the radius at both ends, less what lies below the floor or
above the ceiling, less the discs of that radius about the rims of the other hoops. If nothing is left, there is no
flight.
(`Scenario` itself rejects a vehicle that cannot hover and a hoop that lies entirely outside the heights.)

Diagnosis: the solver runs again with one requirement removed at a time. The first removal that lets it converge names
the suspect. This is no proof.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from flatgym.scenarios.scenario import Scenario
from optimal.direct.program import LONGEST_PHASE
from optimal.direct.shooting import solve_coarse
from optimal.flights.projection_bound import projection_bound

Interval = tuple[float, float]

TOUCH = 1e-9
"""Width of a passage between two rims that is too narrow [m]: the body would touch both."""


def infeasibility_proof(scenario: Scenario) -> str:
    """Return why no flight of a scenario can exist, with the limit at fault; empty if no reason is known."""
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
    """Return where the vehicle's centre may pass on the line of a hoop, as intervals from the hoop's centre [m].

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
        for rim in other.rims:
            offset = rim - hoop.centre
            reach = math.sqrt(max(0.0, radius**2 - float(offset @ hoop.direction) ** 2))
            middle = float(offset @ hoop.across)
            pieces = [piece for a, b in free for piece in ((a, min(b, middle - reach)), (max(a, middle + reach), b))]
            free = [(a, b) for a, b in pieces if a < b - TOUCH] if reach > 0 else free
    return free


def beyond_horizon(scenario: Scenario) -> str:
    """Return why the goal is beyond the longest flight that the solver considers; empty if it is not."""
    least, longest = projection_bound(scenario), LONGEST_PHASE * (len(scenario.hoops) + 1)
    if least <= longest:
        return ""
    return (
        f"The goal is too far: any flight takes at least {least:.4g} s, and the solver considers {longest:g} s at "
        "most; bring it nearer or give more thrust."
    )


def infeasibility_suspect(scenario: Scenario) -> str:
    """Return the requirement that seems to keep the solver from a flight, found by removing one at a time."""
    for change, easier in relaxations(scenario):
        if solve_coarse(easier).converged:
            return f"The optimiser finds a flight {change}; check this requirement."
    return "The optimiser finds no flight even without hoops, floor and ceiling; check goal and thrust_max."


def relaxations(scenario: Scenario) -> Iterator[tuple[str, Scenario]]:
    """Yield a description of each removed requirement and the scenario without it."""
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
