"""Layouts of sampled scenes: hoops on the line to a random goal, and tracks that wander.

On a line, the goal is uniform in a square around the start, outside a minimum distance. Hoops are equally spaced on the
line to it, displaced sideways and rotated by random amounts.

A track starts in a random heading, which bends by a random angle from leg to leg. Each leg ends in a hoop, the last one
in the goal. A hoop faces the bisector of its two legs, up to a random angle. A leg that would end too near to an
earlier place bends to the other side instead. If that is too near as well, it leads straight away from the start, to a
place beyond all earlier ones.

The functions are branch-free in the sampled numbers and work elementwise, so that the same code serves NumPy arrays and
the compiled kernel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

TRIES = 4
"""Maximum number of goals sampled until one is far enough; after that, the last is moved outwards."""
PLACED, PER_HOOP = 3, 4
"""Layout of a sampled scene: goal x, goal z, number of hoops; then x, z, angle, diameter of each hoop."""


def uniforms_needed(hoops: int) -> int:
    """Return the number of uniform numbers for a scene with up to this many hoops, of either layout."""
    return 2 * TRIES + 1 + 4 * hoops


def write_scene(u: Any, numbers: Any, scene: Any) -> None:
    """Write a scene in the layout of PLACED and PER_HOOP.

    Args:
        u: uniform numbers, shape (uniforms_needed, ...).
        numbers: `Distribution.numbers`.
        scene: the array to write to, shape (PLACED + PER_HOOP * most, ...).
    """
    if numbers[9] > 0:
        write_track(u, numbers, scene)
    else:
        write_line(u, numbers, scene)


def write_line(u: Any, numbers: Any, scene: Any) -> None:
    """Write a scene with a random goal and its hoops on the line to it; arguments as for `write_scene`."""
    half, least, fewest, most, aside, turn, narrow, wide = numbers[:8]
    x, z = half * (2 * u[0] - 1), half * (2 * u[1] - 1)
    for i in range(1, TRIES):
        near = 1.0 * (x * x + z * z < least * least)
        x = (1 - near) * x + near * half * (2 * u[2 * i] - 1)
        z = (1 - near) * z + near * half * (2 * u[2 * i + 1] - 1)
    # About once in many millions the goal is still too near. The 1e-300 avoids 0/0 for a goal on the start itself.
    way = np.sqrt(x * x + z * z)
    far = np.maximum(way, least)
    x, z = x * far / np.maximum(way, 1e-300), z * far / np.maximum(way, 1e-300)
    count = fewest + np.floor(u[2 * TRIES] * (most - fewest + 1))
    along_x, along_z = x / far, z / far
    scene[0] = x
    scene[1] = z
    scene[2] = count
    for j in range(int(most)):
        first = 2 * TRIES + 1 + 3 * j
        share, shift = (j + 1) / (count + 1), far / (count + 1) * aside * (2 * u[first] - 1)
        scene[PLACED + PER_HOOP * j] = share * x - shift * along_z
        scene[PLACED + PER_HOOP * j + 1] = share * z + shift * along_x
        scene[PLACED + PER_HOOP * j + 2] = np.arctan2(along_z, along_x) + turn * (2 * u[first + 1] - 1)
        scene[PLACED + PER_HOOP * j + 3] = narrow + (wide - narrow) * u[first + 2]


def write_track(u: Any, numbers: Any, scene: Any) -> None:
    """Write a track, leg by leg, with the goal at the end of the last leg; arguments as for `write_scene`."""
    _, apart, fewest, most, _, turn, narrow, wide, short, long, bend = numbers
    count = fewest + np.floor(u[0] * (most - fewest + 1))
    along_x, along_z = np.cos(2 * np.pi * u[1]), np.sin(2 * np.pi * u[1])
    x, z, reach, goal_x, goal_z = 0.0 * count, 0.0 * count, 0.0 * count, 0.0 * count, 0.0 * count
    scene[2] = count
    for j in range(int(most) + 1):
        first = 2 + 4 * j
        leg, angle = short + (long - short) * u[first], bend * (2 * u[first + 1] - 1)
        cos, sin = leg * np.cos(angle), leg * np.sin(angle)
        left_x, left_z = x + cos * along_x - sin * along_z, z + cos * along_z + sin * along_x
        right_x, right_z = x + cos * along_x + sin * along_z, z + cos * along_z - sin * along_x
        # All earlier places but the one at which this leg begins, which is `short` or more away.
        from_start = apart if j > 0 else 0.0
        left = 1.0 * (left_x**2 + left_z**2 >= from_start**2)
        right = 1.0 * (right_x**2 + right_z**2 >= from_start**2)
        for i in range(j - 1):
            before_x, before_z = scene[PLACED + PER_HOOP * i], scene[PLACED + PER_HOOP * i + 1]
            left = left * ((left_x - before_x) ** 2 + (left_z - before_z) ** 2 >= apart**2)
            right = right * ((right_x - before_x) ** 2 + (right_z - before_z) ** 2 >= apart**2)
        # Every place but the start is `apart` or more from the start.
        way = np.maximum(np.sqrt(x * x + z * z), apart)
        right, out = (1 - left) * right, (1 - left) * (1 - right) * (reach + apart) / way
        next_x, next_z = left * left_x + right * right_x + out * x, left * left_z + right * right_z + out * z
        step_x, step_z = next_x - x, next_z - z
        length = np.sqrt(step_x * step_x + step_z * step_z)
        step_x, step_z = step_x / length, step_z / length
        if j > 0:
            facing = np.arctan2(along_z + step_z, along_x + step_x)
            scene[PLACED + PER_HOOP * j - 2] = facing + turn * (2 * u[first - 2] - 1)
            scene[PLACED + PER_HOOP * j - 1] = narrow + (wide - narrow) * u[first - 1]
        x, z, along_x, along_z = next_x, next_z, step_x, step_z
        reach = np.maximum(reach, np.sqrt(x * x + z * z))
        last = 1.0 * (count == j)
        goal_x, goal_z = goal_x + last * x, goal_z + last * z
        if j < most:
            scene[PLACED + PER_HOOP * j] = x
            scene[PLACED + PER_HOOP * j + 1] = z
    scene[0] = goal_x
    scene[1] = goal_z
