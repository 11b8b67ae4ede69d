"""Distributions of scenarios: the scenario of an episode is a function of its seed and number.

Hoops lie on the line to a random goal, or on a track that wanders (`flatgym.scenarios.layouts`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flatgym.arrays import library
from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.content import Content, build, fields_of
from flatgym.scenarios.counter_rng import SCENE, uniform
from flatgym.scenarios.layouts import PER_HOOP, PLACED, uniforms_needed, write_scene
from flatgym.scenarios.scenario import GAP_LEAST, Hoop, Scenario, Tolerance, build_parts, steps_within
from flatgym.validation import number, pair, positive

HOOPS_MOST = 8
"""Maximum number of hoops of a sampled scenario."""


@dataclass(frozen=True)
class Distribution(Content):
    """Scenarios from the origin to a random goal, through a random number of hoops.

    With `leg`, the scenarios are tracks, and `half_width` and `aside` have no effect. Without, `bend` has none.

    Attributes:
        name: its name; its scenarios are called name-seed-episode.
        half_width: half the width of the square of goals [m].
        least_distance: minimum distance of the goal, and on tracks of any two of start, hoops and goal [m].
        hoops: minimum and maximum number of hoops.
        aside: maximum sideways displacement of a hoop, as a fraction of the hoop spacing.
        turn: maximum angle between a hoop's direction and the line to the goal, or the bisector of its legs [rad].
        diameter: minimum and maximum width of a gap [m].
        leg: minimum and maximum distance from one hoop of a track to the next [m]; None for hoops on a line.
        bend: maximum angle between two consecutive legs of a track [rad].
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
    leg: tuple[float, float] | None = None
    bend: float = 2.0
    quadrotor: Quadrotor = field(default_factory=Quadrotor)
    tolerance: Tolerance = field(default_factory=Tolerance)
    dt: float = 0.02
    time_limit: float = 5.0

    def __post_init__(self) -> None:
        owner = "Distribution"
        for name in ("half_width", "least_distance", "dt", "time_limit"):
            object.__setattr__(self, name, positive(owner, name, getattr(self, name)))
        for name in ("aside", "turn", "bend"):
            object.__setattr__(self, name, number(owner, name, getattr(self, name)))
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"{owner}.name must be a non-empty string, got {self.name!r}")
        for name, kind in (("quadrotor", Quadrotor), ("tolerance", Tolerance)):
            if not isinstance(getattr(self, name), kind):
                raise ValueError(f"{owner}.{name} must be a {kind.__name__}, got {getattr(self, name)!r}")
        self._check_hoops()
        self._check_distances()
        self.scenario(0, 0)  # validates vehicle, dt and time limit

    def _check_hoops(self) -> None:
        low, high = pair("Distribution", "hoops", self.hoops)
        if not (isinstance(low, int) and isinstance(high, int) and 0 <= low <= high <= HOOPS_MOST):
            raise ValueError(f"Distribution.hoops must be two whole numbers 0 <= a <= b <= {HOOPS_MOST}: {self.hoops}")
        object.__setattr__(self, "hoops", (int(low), int(high)))
        narrow, wide = (
            number("Distribution", "diameter", width) for width in pair("Distribution", "diameter", self.diameter)
        )
        least = 2 * self.quadrotor.radius + GAP_LEAST
        if not least <= narrow <= wide:
            raise ValueError(
                f"Distribution.diameter must be two widths {least:.9g} m <= a <= b for a body of radius "
                f"{self.quadrotor.radius} m, got {self.diameter}"
            )
        object.__setattr__(self, "diameter", (narrow, wide))
        for name in ("turn", "bend"):
            if abs(getattr(self, name)) > math.pi:
                raise ValueError(f"Distribution.{name} must lie within half a turn, pi, got {getattr(self, name)}")

    def _check_distances(self) -> None:
        most, limit, far = self.half_width, "half_width", "half_width * sqrt(2) * (1 + |aside|)"
        if self.leg is not None:
            short, long = (positive("Distribution", "leg", length) for length in pair("Distribution", "leg", self.leg))
            if not short <= long:
                raise ValueError(f"Distribution.leg must be two lengths a <= b, got {self.leg}")
            object.__setattr__(self, "leg", (short, long))
            if self.least_distance < self.diameter[1]:
                raise ValueError(
                    f"Distribution.least_distance must be at least diameter[1] = {self.diameter[1]} m on tracks, so "
                    f"that no two gaps touch, got {self.least_distance}"
                )
            most, limit, far = short, "leg[0]", "leg[1] * (hoops[1] + 1)"
        if not self.tolerance.position < self.least_distance <= most:
            raise ValueError(
                f"Distribution.least_distance must lie above tolerance.position = {self.tolerance.position} m and not "
                f"above {limit} = {most} m, got {self.least_distance}"
            )
        number("Distribution", f"{far}, the farthest hoop,", self.farthest)

    @property
    def farthest(self) -> float:
        """An upper bound of the distance of goal and hoops from the start [m]."""
        if self.leg is not None:
            return (self.hoops[1] + 1) * self.leg[1]
        return self.half_width * math.sqrt(2) * (1 + abs(self.aside))

    @property
    def max_steps(self) -> int:
        """Time limit in steps."""
        return steps_within(self.time_limit, self.dt)

    def scenario(self, seed: int, episode: int = 0) -> Scenario:
        """Return the scenario of an episode: that of an environment seeded with `seed`, after `episode` more resets."""
        for name, value in (("seed", seed), ("episode", episode)):
            if library(value) in ("torch", "jax"):
                raise TypeError(
                    f"{name} must be a whole number, got an array of {library(value)}: a Scenario holds plain numbers "
                    "and cannot be drawn under jit; flatgym.task.drawing.draw draws scenes there"
                )
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
        """The parameters of `write_scene`, shape (11,); the legs of scenarios that are not tracks are 0."""
        return (
            self.half_width,
            self.least_distance,
            float(self.hoops[0]),
            float(self.hoops[1]),
            self.aside,
            self.turn,
            *self.diameter,
            *(self.leg or (0.0, 0.0)),
            self.bend,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as dicts, lists, numbers and strings, ready for JSON; "kind" tells it from a scenario."""
        return {"kind": "distribution"} | super().to_dict()

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Distribution:
        """Return the distribution of a `to_dict`; errors as for the constructor, and as in `content.build`."""
        values = fields_of(data, "distribution")
        return build(cls, values | build_parts(values, "Distribution"), "Distribution")


DISTRIBUTIONS = {
    distribution.name: distribution
    for distribution in (
        Distribution("random-goal"),
        Distribution("random-hoops", least_distance=3.0, hoops=(1, 3)),
        Distribution("random-track", least_distance=1.5, hoops=(4, 8), leg=(2.0, 4.0), time_limit=10.0),
    )
}
"""The named distributions, by name."""
