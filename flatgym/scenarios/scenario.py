"""A task as a value: start and goal, hoops, height limits, vehicle, tolerance, time step and time limit.

A Scenario is frozen and validated, compares by value, and round-trips through JSON. Invalid values raise a ValueError
that names the field, the value, and what is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.content import Content, build, fields_of
from flatgym.validation import number, point, positive

BOUNDS_MARGIN = 5.0
"""Distance of the bounds from the bounding box of start, goal and hoop centres [m]."""
GAP_LEAST = 1e-7
"""Minimum width of a gap beyond that of the body [m]; solvers and certificates cannot tell smaller ones from none."""
STEPS_MOST = 1_000_000
"""Maximum number of steps of a time limit."""


def steps_within(time_limit: float, dt: float) -> int:
    """Return the time limit in steps of dt [s]; a ValueError for less than one step and more than STEPS_MOST."""
    if not dt <= time_limit <= STEPS_MOST * dt:
        raise ValueError(
            f"Scenario.time_limit must be at least dt = {dt} and at most {STEPS_MOST} dt = {STEPS_MOST * dt} s, "
            f"got {time_limit}"
        )
    return round(time_limit / dt)


def check_radians(owner: str, angle: float, most: float) -> None:
    """Raise a ValueError for an angle [rad] beyond `most`, which is probably in degrees."""
    if abs(angle) > most:
        raise ValueError(
            f"{owner}.angle is in radians and must lie within {most / math.pi:g} pi = {most:.4g}, got {angle:g}; "
            f"{angle:g} degrees are {math.radians(angle):.6g}"
        )


@dataclass(frozen=True)
class Hoop:
    """A gap; it is passed when the path crosses it in its direction.

    Attributes:
        x, z: centre of the gap [m].
        diameter: width of the gap [m].
        angle: direction of passage, from +x towards +z [rad]; 0 is the paper's vertical hoop, passed left to right.
    """

    x: float
    z: float
    diameter: float
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("x", "z", "angle"):
            object.__setattr__(self, name, number("Hoop", name, getattr(self, name)))
        object.__setattr__(self, "diameter", positive("Hoop", "diameter", self.diameter))
        check_radians("Hoop", self.angle, 2 * math.pi)

    @property
    def centre(self) -> Array:
        """Centre of the gap [m], shape (2,)."""
        return np.array([self.x, self.z])

    @property
    def direction(self) -> Array:
        """Unit vector of passage, shape (2,)."""
        return np.array([math.cos(self.angle), math.sin(self.angle)])

    @property
    def rims(self) -> Array:
        """Both ends of the gap [m], shape (2, 2): first the end at -`across`, then the one at +`across`."""
        return self.centre + np.outer([-0.5, 0.5], self.diameter * self.across)

    def half_gap(self, radius: float = 0.0) -> float:
        """Return the maximum distance from the gap's centre at which a body of that radius [m] can cross it [m]."""
        return self.diameter / 2 - radius

    @property
    def across(self) -> Array:
        """Unit vector along the gap: `direction` rotated by pi/2 from +x to +z, shape (2,)."""
        return np.array([-math.sin(self.angle), math.cos(self.angle)])


@dataclass(frozen=True)
class Tolerance:
    """The goal set: |p - goal| <= position, |v| <= speed, theta within `angle` of a multiple of 2 pi.

    Attributes:
        position: maximum distance to the goal [m].
        speed: maximum speed [m/s].
        angle: maximum distance of theta to the nearest multiple of 2 pi [rad].
    """

    position: float = 0.1
    speed: float = 0.2
    angle: float = 0.1

    def __post_init__(self) -> None:
        for name in ("position", "speed", "angle"):
            object.__setattr__(self, name, positive("Tolerance", name, getattr(self, name)))
        check_radians("Tolerance", self.angle, math.pi)


@dataclass(frozen=True)
class Scenario(Content):
    """One task: rest to rest from start to goal, through hoops in order.

    Attributes:
        name: its name.
        start, goal: points (x, z) at which the flight starts and ends, at rest and upright [m].
        hoops: the hoops, in order of passage.
        floor, ceiling: minimum and maximum height of the vehicle's centre [m], or None.
        quadrotor: the vehicle.
        tolerance: the goal tolerance.
        dt: length of an environment step, over which the control is constant [s].
        time_limit: time after which an episode is truncated [s].

    Raises:
        ValueError: naming the field, its value and what is allowed.
    """

    name: str
    start: tuple[float, float]
    goal: tuple[float, float]
    hoops: tuple[Hoop, ...] = ()
    floor: float | None = None
    ceiling: float | None = None
    quadrotor: Quadrotor = field(default_factory=Quadrotor)
    tolerance: Tolerance = field(default_factory=Tolerance)
    dt: float = 0.02
    time_limit: float = 5.0

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"Scenario.name must be a non-empty string, got {self.name!r}")
        for name in ("start", "goal"):
            put(name, point("Scenario", name, getattr(self, name)))
        for name in ("floor", "ceiling"):
            if getattr(self, name) is not None:
                put(name, number("Scenario", name, getattr(self, name)))
        for name in ("dt", "time_limit"):
            put(name, positive("Scenario", name, getattr(self, name)))
        if not isinstance(self.hoops, (tuple, list)):
            raise ValueError(f"Scenario.hoops must be a tuple of hoops, got {self.hoops!r}")
        put("hoops", tuple(self.hoops))
        for name, kind in (("quadrotor", Quadrotor), ("tolerance", Tolerance)):
            if not isinstance(getattr(self, name), kind):
                raise ValueError(f"Scenario.{name} must be a {kind.__name__}, got {getattr(self, name)!r}")
        self.quadrotor.require_hover("Scenario.quadrotor")
        self._check_heights()
        self._check_hoops()
        if self.dt * self.quadrotor.rate_max >= 2 * math.pi:
            raise ValueError(
                f"Scenario.dt must be below 2 pi / rate_max = {2 * math.pi / self.quadrotor.rate_max:.4g} s, so that "
                f"no step makes a whole turn, got {self.dt}"
            )
        steps_within(self.time_limit, self.dt)
        if not self.hoops and math.dist(self.start, self.goal) <= self.tolerance.position:
            raise ValueError(
                f"Scenario.goal {self.goal} lies within tolerance.position = {self.tolerance.position} m "
                f"of the start {self.start}: the start is already at the goal"
            )

    def _check_heights(self) -> None:
        low, high = self.heights
        if low >= high:
            raise ValueError(f"Scenario.ceiling must lie above the floor at {self.floor} m, got {self.ceiling}")
        for name in ("start", "goal"):
            height = getattr(self, name)[1]
            if height < low:
                raise ValueError(f"Scenario.{name} lies at z = {height} m, below the floor at {self.floor} m")
            if height > high:
                raise ValueError(f"Scenario.{name} lies at z = {height} m, above the ceiling at {self.ceiling} m")

    def _check_hoops(self) -> None:
        for i, hoop in enumerate(self.hoops):
            where = f"Scenario.hoops[{i}]"
            if not isinstance(hoop, Hoop):
                raise ValueError(f"{where} must be a Hoop, got {hoop!r}")
            if hoop.diameter < self.narrowest_gap:
                raise ValueError(
                    f"{where}: a gap of {hoop.diameter} m is too small for a body of "
                    f"radius {self.quadrotor.radius} m; it must be at least {self.narrowest_gap:.9g} m wide"
                )
            reach = hoop.half_gap(self.quadrotor.radius) * abs(math.cos(hoop.angle))
            low, high = self.heights
            if hoop.z + reach < low:
                raise ValueError(f"{where} lies wholly below the floor at {self.floor} m: {hoop}")
            if hoop.z - reach > high:
                raise ValueError(f"{where} lies wholly above the ceiling at {self.ceiling} m: {hoop}")

    @property
    def start_state(self) -> Array:
        """The state at rest and upright at the start, shape (5,)."""
        return np.array([*self.start, 0.0, 0.0, 0.0])

    @property
    def goal_state(self) -> Array:
        """The state at rest and upright at the goal, shape (5,)."""
        return np.array([*self.goal, 0.0, 0.0, 0.0])

    @property
    def max_steps(self) -> int:
        """Time limit in steps."""
        return steps_within(self.time_limit, self.dt)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Minimum x, minimum z, maximum x, maximum z [m]; a step that ends outside is out of bounds."""
        points = np.array([self.start, self.goal, *((hoop.x, hoop.z) for hoop in self.hoops)])
        low, high = points.min(axis=0) - BOUNDS_MARGIN, points.max(axis=0) + BOUNDS_MARGIN
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @property
    def heights(self) -> tuple[float, float]:
        """Minimum and maximum height of the vehicle's centre [m]; infinite without floor or ceiling."""
        return (
            -math.inf if self.floor is None else self.floor,
            math.inf if self.ceiling is None else self.ceiling,
        )

    @property
    def narrowest_gap(self) -> float:
        """Minimum diameter of a hoop: that of the body, and GAP_LEAST [m]."""
        return 2 * self.quadrotor.radius + GAP_LEAST

    def narrowed(self, share: float) -> Scenario:
        """Return the scenario with gaps that keep a share of their free width, their width less that of the body."""
        body = 2 * self.quadrotor.radius
        widths = (body + share * (hoop.diameter - body) for hoop in self.hoops)
        return self.with_diameters(max(width, self.narrowest_gap) for width in widths)

    def with_diameters(self, diameters: Iterable[float]) -> Scenario:
        """Return the scenario with other gap widths [m], one for each hoop.

        Raises:
            ValueError: for a wrong number of widths, and for a gap too small for the body.
        """
        widths = tuple(diameters)
        if len(widths) != len(self.hoops):
            raise ValueError(f"Scenario.with_diameters needs {len(self.hoops)} widths, one a hoop, got {len(widths)}")
        hoops = (replace(hoop, diameter=width) for hoop, width in zip(self.hoops, widths, strict=True))
        return replace(self, hoops=tuple(hoops))

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Scenario:
        """Return the scenario of a `to_dict`; errors as for the constructor, and as in `content.build`."""
        values = fields_of(data, "scenario")
        if isinstance(hoops := values.get("hoops", ()), (list, tuple)):
            values["hoops"] = tuple(build(Hoop, hoop, f"Scenario.hoops[{i}]") for i, hoop in enumerate(hoops))
        return build(cls, values | build_parts(values, "Scenario"), "Scenario")


def build_parts(values: dict[str, Any], owner: str) -> dict[str, Any]:
    """Return quadrotor and tolerance of a `to_dict`, those that are there; errors as in `content.build`."""
    kinds = {"quadrotor": Quadrotor, "tolerance": Tolerance}
    return {name: build(kind, values[name], f"{owner}.{name}") for name, kind in kinds.items() if name in values}
