"""The named tracks: figures of drone racing, in the vertical plane.

slalom, slalom-6, zigzag-12    hoops on alternating sides of a straight line
loop                           four gaps on a circle, the first of which is passed again
split-s                        up through the upper hoop, roll over, dive, back through the hoop below it
figure-eight                   over the top of two circles, one in each direction, through a hoop where they meet
ladder                         switchbacks: each hoop is above the last one, and passed in the opposite direction
"""

from __future__ import annotations

import math

from flatgym.scenarios.scenario import Hoop, Scenario

_RIGHT, _UP, _LEFT, _DOWN = 0.0, math.pi / 2, math.pi, 3 * math.pi / 2


def weave(name: str, count: int, spacing: float, height: float, end: float, time_limit: float = 5.0) -> Scenario:
    """Return a track along +x through hoops alternately `height` above and below the start.

    Args:
        name: its name.
        count: number of hoops.
        spacing: distance of the hoops along x [m].
        height: height of the odd hoops [m]; the even ones are at its negative.
        end: distance of the goal behind the last hoop along x [m].
        time_limit: as in Scenario [s].
    """
    hoops = tuple(Hoop(spacing * i, height if i % 2 else -height, 0.5) for i in range(1, count + 1))
    return Scenario(name, (0.0, 0.0), (spacing * count + end, 0.0), hoops=hoops, time_limit=time_limit)


TRACKS = (
    weave("slalom", 3, 2.5, 1.5, 1.5),
    Scenario(
        "loop",
        (0.0, 0.0),
        (6.0, 0.0),
        hoops=(
            Hoop(3.0, 0.0, 1.0, _RIGHT),
            Hoop(4.5, 1.5, 1.0, _UP),
            Hoop(3.0, 3.0, 1.0, _LEFT),
            Hoop(1.5, 1.5, 1.0, _DOWN),
            Hoop(3.0, 0.0, 1.0, _RIGHT),
        ),
    ),
    Scenario("split-s", (0.0, 0.0), (0.0, 0.0), hoops=(Hoop(4.0, 3.0, 0.5, _RIGHT), Hoop(4.0, 0.0, 0.5, _LEFT))),
    Scenario(
        "ladder",
        (0.0, 0.0),
        (0.0, 7.0),
        hoops=(
            Hoop(1.5, 1.0, 0.5, _RIGHT),
            Hoop(-1.5, 2.5, 0.5, _LEFT),
            Hoop(1.5, 4.0, 0.5, _RIGHT),
            Hoop(-1.5, 5.5, 0.5, _LEFT),
        ),
        time_limit=10.0,
    ),
    # The circles have a radius of 1.5 m and their centres at (2, 0) and (-2, 0).
    Scenario(
        "figure-eight",
        (0.0, 0.0),
        (0.0, 0.0),
        hoops=(
            Hoop(2.0, 1.5, 1.0, _RIGHT),
            Hoop(3.5, 0.0, 1.0, _DOWN),
            Hoop(2.0, -1.5, 1.0, _LEFT),
            Hoop(0.0, 0.0, 1.0, (_UP + _LEFT) / 2),
            Hoop(-2.0, 1.5, 1.0, _LEFT),
            Hoop(-3.5, 0.0, 1.0, _DOWN),
            Hoop(-2.0, -1.5, 1.0, _RIGHT),
        ),
        time_limit=10.0,
    ),
    weave("slalom-6", 6, 2.5, 1.5, 1.5, time_limit=15.0),
    weave("zigzag-12", 12, 2.0, 1.0, 2.0, time_limit=20.0),
)
"""Tracks through two or more hoops, from rest to rest."""
