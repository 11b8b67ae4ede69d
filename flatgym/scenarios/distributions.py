"""Distributions of scenarios: the scenario of an episode is a function of its seed and number.

The goal is uniform in a square around the start, outside a minimum distance. Hoops are equally spaced on the line to
the goal, displaced sideways and rotated by random amounts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.counter_rng import SCENE, uniform
from flatgym.scenarios.scenario import Hoop, Scenario, Tolerance, steps_within
from flatgym.validation import number, pair, positive

TRIES = 4
"""Maximum number of goals sampled until one is far enough; after that, the last is moved outwards."""
HOOPS_MOST = 8
"""Maximum number of hoops of a sampled scenario."""
PLACED, PER_HOOP = 3, 4
"""Layout of a sampled scene: goal x, goal z, number of hoops; then x, z, angle, diameter of each hoop."""


@dataclass(frozen=True)
class Distribution:
    """Scenarios from the origin to a random goal, through a random number of hoops.

    Attributes:
        name: its name; its scenarios are called name-seed-episode.
        half_width: half the width of the square of goals [m].
        least_distance: minimum distance of the goal [m].
        hoops: minimum and maximum number of hoops.
        aside: maximum sideways displacement of a hoop, as a fraction of the hoop spacing.
        turn: maximum angle between a hoop's direction and the line to the goal [rad].
        diameter: minimum and maximum width of a gap [m].
        quadrotor, tolerance, dt, time_limit: as in Scenario, shared by all scenarios.

    Raises:
        ValueError: naming the field, its value and what is allowed.
    """

    name: str
    half_width: float = 10.0
    least_distance: float = 0.5
    hoops: tuple[int, int] = (0, 0)
    aside: float = 0.25
    turn: float = 0.5
    diameter: tuple[float, float] = (0.5, 1.0)
    quadrotor: Quadrotor = field(default_factory=Quadrotor)
    tolerance: Tolerance = field(default_factory=Tolerance)
    dt: float = 0.02
    time_limit: float = 5.0

    def __post_init__(self) -> None:
        owner = "Distribution"
        for name in ("half_width", "least_distance"):
            object.__setattr__(self, name, positive(owner, name, getattr(self, name)))
        for name in ("aside", "turn"):
            object.__setattr__(self, name, number(owner, name, getattr(self, name)))
        for name, kind in (("name", str), ("quadrotor", Quadrotor), ("tolerance", Tolerance)):
            if not isinstance(getattr(self, name), kind):
                raise ValueError(f"{owner}.{name} must be a {kind.__name__}, got {getattr(self, name)!r}")
        self._check_hoops()
        if not self.tolerance.position < self.least_distance <= self.half_width:
            raise ValueError(
                f"Distribution.least_distance must lie above tolerance.position = {self.tolerance.position} m and not "
                f"above half_width = {self.half_width} m, got {self.least_distance}"
            )
        self.scenario(0, 0)  # validates vehicle, dt and time limit

    def _check_hoops(self) -> None:
        low, high = pair("Distribution", "hoops", self.hoops)
        if not (isinstance(low, int) and isinstance(high, int) and 0 <= low <= high <= HOOPS_MOST):
            raise ValueError(f"Distribution.hoops must be two whole numbers 0 <= a <= b <= {HOOPS_MOST}: {self.hoops}")
        narrow, wide = (
            number("Distribution", "diameter", width) for width in pair("Distribution", "diameter", self.diameter)
        )
        if not 2 * self.quadrotor.radius < narrow <= wide:
            raise ValueError(
                f"Distribution.diameter must be two widths a <= b above twice the radius "
                f"{self.quadrotor.radius} m, got {self.diameter}"
            )
        if abs(self.turn) > math.pi:
            raise ValueError(f"Distribution.turn must lie within half a turn, pi, got {self.turn}")
        number("Distribution", "half_width * sqrt(2) * (1 + |aside|), the farthest hoop,", self.farthest)

    @property
    def farthest(self) -> float:
        """An upper bound of the distance of goal and hoops from the start [m]."""
        return self.half_width * math.sqrt(2) * (1 + abs(self.aside))

    @property
    def max_steps(self) -> int:
        """Time limit in steps."""
        return steps_within(self.time_limit, self.dt)

    def scenario(self, seed: int, episode: int = 0) -> Scenario:
        """Return the scenario of an episode: that of an environment seeded with `seed`, after `episode` more resets."""
        row = self.draw(np.array([seed], dtype=np.uint64), np.array([episode], dtype=np.uint64))[0]
        hoops = row[PLACED : PLACED + PER_HOOP * int(row[2])].reshape(-1, PER_HOOP).tolist()
        return Scenario(
            f"{self.name}-{seed}-{episode}",
            (0.0, 0.0),
            (float(row[0]), float(row[1])),
            hoops=tuple(Hoop(x, z, diameter, angle) for x, z, angle, diameter in hoops),
            quadrotor=self.quadrotor,
            tolerance=self.tolerance,
            dt=self.dt,
            time_limit=self.time_limit,
        )

    def draw(self, seed: Any, episode: Any) -> Array:
        """Return the scenes of n episodes as `write_scene` writes them, shape (n, PLACED + PER_HOOP * hoops[1]).

        Args:
            seed, episode: uint64, shape (n,).
        """
        count = uniforms_needed(self.hoops[1])
        u = np.stack([uniform(seed, episode, np.uint64(SCENE + i)) for i in range(count)])
        scene = np.zeros((PLACED + PER_HOOP * self.hoops[1], u.shape[1]))
        write_scene(u, self.numbers, scene)
        return np.ascontiguousarray(scene.T)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The parameters of `write_scene`, shape (8,)."""
        return (
            self.half_width,
            self.least_distance,
            float(self.hoops[0]),
            float(self.hoops[1]),
            self.aside,
            self.turn,
            *self.diameter,
        )


def uniforms_needed(hoops: int) -> int:
    """Return the number of uniform numbers for a scene with up to this many hoops."""
    return 2 * TRIES + 1 + 3 * hoops


def write_scene(u: Any, numbers: Any, scene: Any) -> None:
    """Write a scene in the layout of PLACED and PER_HOOP from uniform numbers u, shape (draws, ...), elementwise.

    Branch-free, so that the same code serves NumPy arrays and the compiled kernel.
    """
    half, least, fewest, most, aside, turn, narrow, wide = numbers
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
        first = uniforms_needed(j)
        share, shift = (j + 1) / (count + 1), far / (count + 1) * aside * (2 * u[first] - 1)
        scene[PLACED + PER_HOOP * j] = share * x - shift * along_z
        scene[PLACED + PER_HOOP * j + 1] = share * z + shift * along_x
        scene[PLACED + PER_HOOP * j + 2] = np.arctan2(along_z, along_x) + turn * (2 * u[first + 1] - 1)
        scene[PLACED + PER_HOOP * j + 3] = narrow + (wide - narrow) * u[first + 2]


DISTRIBUTIONS = {
    distribution.name: distribution
    for distribution in (
        Distribution("random-goal"),
        Distribution("random-hoops", least_distance=3.0, hoops=(1, 3)),
    )
}
"""The named distributions, by name."""
