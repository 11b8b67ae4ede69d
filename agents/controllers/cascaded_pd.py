"""The classical baseline: a cascaded PD controller that knows the vehicle and sees what any policy sees.

    way to the target -> velocity -> acceleration -> tilt and thrust -> rate

Each arrow is a proportional law; the first two together are a PD controller of the position, whose wanted speed
is proportional to the way near the target, and far away the one from which the vehicle can still brake,

    v = min(approach d + v_end, sqrt(v_end^2 + 2 braking d)).

The target is the next hoop, flown through in its direction at a speed v_end that leaves time to turn, and after
the last hoop the goal. It plans nothing and never flips: what it lacks to the optimum is what planning is worth.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array, Quadrotor
from flatgym.task.decoding import DecodedObservation, decode_observation

INSIDE = 0.35
"""How far beside its axis a gap counts as lying ahead, as a share of its width."""
LIFT_LEFT = 0.95
"""Share of the greatest thrust that the height may take, so that some is left for the side."""
LEVEL = 0.3
"""Cosine of the tilt below which thrust is not raised any more to keep the height."""
TINY = 1e-9
"""A way so short has no direction [m]."""


@dataclass(frozen=True)
class CascadedPD:
    """A cascaded PD controller with the `predict` of a Stable-Baselines3 model.

    The gains are those found to be fastest on the named scenarios and on a few hundred drawn ones, all reached.

    Attributes:
        quadrotor: the vehicle that is flown.
        approach: wanted speed by distance, near the target [1/s].
        braking: deceleration with which the wanted speed reckons, far from it [m/s^2].
        damping: wanted acceleration by missing speed [1/s].
        turning: wanted rate by missing tilt [1/s].
        tilt: greatest wanted tilt [rad].
        passing: wanted speed at a hoop behind which the way goes straight on [m/s].
        beyond: how far behind a hoop to aim when its gap lies ahead, and how far before it when it was missed [m].
        clearance: least height above a floor, and below a ceiling, to aim at [m].
    """

    quadrotor: Quadrotor = field(default_factory=Quadrotor)
    approach: float = 4.2
    braking: float = 5.7
    damping: float = 10.0
    turning: float = 27.0
    tilt: float = 1.26
    passing: float = 2.5
    beyond: float = 0.6
    clearance: float = 0.05

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,  # noqa: ARG002 - as Stable-Baselines3 calls it
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions, shape (..., 2), for observations, shape (..., 19); the state is handed back as it came."""
        seen = decode_observation(observation)
        action = self.quadrotor.action(self._control(seen, self._acceleration(seen)))
        return np.clip(action, -1, 1).astype(np.float32), state

    def _acceleration(self, seen: DecodedObservation) -> Array:
        """Return the wanted acceleration [m/s^2], shape (..., 2)."""
        way, speed = self._target(seen)
        distance = np.maximum(_norm(way), TINY)
        near, far = self.approach * distance + speed, np.sqrt(speed**2 + 2 * self.braking * distance)
        velocity = way * (np.minimum(near, far) / distance)[..., None]
        return self.damping * (velocity - seen.velocity)

    def _target(self, seen: DecodedObservation) -> tuple[Array, Array]:
        """Return the way to what is flown to next [m], shape (..., 2), and the wanted speed there [m/s] (...)."""
        low, high = self.clearance - seen.floor, seen.ceiling - self.clearance
        goal = np.stack([seen.goal[..., 0], np.clip(seen.goal[..., 1], low, np.maximum(low, high))], axis=-1)
        hoop, direction = seen.hoops[..., 0, :], seen.directions[..., 0, :]
        onwards = np.where(seen.ahead[..., 1, None], seen.hoops[..., 1, :], goal) - hoop
        length = np.maximum(_norm(onwards), TINY)
        straight = np.clip(_dot(onwards, direction) / length, 0.3, 1.0)
        speed = np.minimum(self.passing * straight, np.sqrt(2 * self.braking * length))
        before = _dot(hoop, direction) > 0
        aside = np.abs(_dot(hoop, direction[..., ::-1] * [-1, 1]))
        through = np.where(aside < INSIDE * seen.diameters[..., 0], self.beyond, 0.0)
        way = hoop + np.where(before, through, -self.beyond)[..., None] * direction
        there = seen.ahead[..., 0]
        return np.where(there[..., None], way, goal), np.where(there & before, speed, 0.0)

    def _control(self, seen: DecodedObservation, acceleration: Array) -> Array:
        """Return [thrust, rate], shape (..., 2): the height comes first, and what thrust is left goes to the side."""
        q = self.quadrotor
        lift = np.clip(acceleration[..., 1] + q.gravity, q.thrust_min, LIFT_LEFT * q.thrust_max)
        most = np.minimum(np.sqrt(q.thrust_max**2 - lift**2), np.tan(self.tilt) * lift)
        tilt = np.arctan2(np.clip(acceleration[..., 0], -most, most), lift)
        missing = np.arctan2(np.sin(tilt - seen.theta), np.cos(tilt - seen.theta))
        return np.stack([lift / np.maximum(seen.cos, LEVEL), self.turning * missing], axis=-1)


def _dot(one: Array, other: Array) -> Array:
    return np.sum(one * other, axis=-1)


def _norm(way: Array) -> Array:
    return np.hypot(way[..., 0], way[..., 1])
