"""Cascaded PD control: the classical baseline. It knows the vehicle and takes the same observations as any policy.

    displacement to the target -> velocity -> acceleration -> tilt and thrust -> rate

Each arrow is a proportional law. The first two form a PD controller of the position. The speed set-point is
proportional to the distance d near the target; farther away it is the speed from which the vehicle can still brake,

    v = min(approach d + v_end, sqrt(v_end^2 + 2 braking d)).

The target is the next hoop, crossed in its direction at a speed v_end that leaves time to turn; after the last hoop
it is the goal. The controller does not plan and never flips. Its gap to the optimum is the value of planning.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array, Quadrotor
from flatgym.task.observation import DecodedObservation, decode_observation

AHEAD_SHARE = 0.35
"""Largest lateral offset from a hoop's axis at which its gap counts as ahead, as a share of the diameter."""
LIFT_SHARE = 0.95
"""Largest share of thrust_max for the vertical axis; the rest is left for the horizontal one."""
MIN_COS_TILT = 0.3
"""Smallest cosine of the tilt for which the thrust is raised to hold the height."""
MIN_DISTANCE = 1e-9
"""Lower bound of distances, which avoids division by zero [m]."""


@dataclass(frozen=True)
class CascadedPD:
    """A cascaded PD controller with the `predict` of a Stable-Baselines3 model.

    The gains are the fastest found that reach the goal on the named scenarios and on a few hundred sampled ones.

    Attributes:
        quadrotor: the vehicle.
        approach: speed set-point per distance near the target [1/s].
        braking: deceleration assumed for the speed set-point far from the target [m/s^2].
        damping: acceleration set-point per velocity error [1/s].
        turning: rate set-point per tilt error [1/s].
        tilt: largest tilt set-point [rad].
        passing: speed set-point at a hoop after which the path goes straight on [m/s].
        overshoot: distance of the aim point behind a hoop that is ahead, or before a hoop that was missed [m].
        clearance: smallest height of the goal set-point above a floor and below a ceiling [m].
    """

    quadrotor: Quadrotor = field(default_factory=Quadrotor)
    approach: float = 4.2
    braking: float = 5.7
    damping: float = 10.0
    turning: float = 27.0
    tilt: float = 1.26
    passing: float = 2.5
    overshoot: float = 0.6
    clearance: float = 0.05

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,  # noqa: ARG002 - as Stable-Baselines3 calls it
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (..., 2) for observations (..., 19), and `state` unchanged."""
        seen = decode_observation(observation)
        action = self.quadrotor.action(self._control(seen, self._acceleration(seen)))
        return np.clip(action, -1, 1).astype(np.float32), state

    def _acceleration(self, seen: DecodedObservation) -> Array:
        """Return the acceleration set-point [m/s^2], shape (..., 2)."""
        displacement, speed = self._target(seen)
        distance = np.maximum(_norm(displacement), MIN_DISTANCE)
        near, far = self.approach * distance + speed, np.sqrt(speed**2 + 2 * self.braking * distance)
        velocity = displacement * (np.minimum(near, far) / distance)[..., None]
        return self.damping * (velocity - seen.velocity)

    def _target(self, seen: DecodedObservation) -> tuple[Array, Array]:
        """Return the displacement to the target [m], shape (..., 2), and the speed set-point there [m/s] (...)."""
        low, high = self.clearance - seen.floor, seen.ceiling - self.clearance
        goal = np.stack([seen.goal[..., 0], np.clip(seen.goal[..., 1], low, np.maximum(low, high))], axis=-1)
        hoop, direction = seen.hoops[..., 0, :], seen.directions[..., 0, :]
        onwards = np.where(seen.ahead[..., 1, None], seen.hoops[..., 1, :], goal) - hoop
        length = np.maximum(_norm(onwards), MIN_DISTANCE)
        straight = np.clip(_dot(onwards, direction) / length, 0.3, 1.0)
        speed = np.minimum(self.passing * straight, np.sqrt(2 * self.braking * length))
        before = _dot(hoop, direction) > 0
        offset = np.abs(_dot(hoop, direction[..., ::-1] * [-1, 1]))
        through = np.where(offset < AHEAD_SHARE * seen.diameters[..., 0], self.overshoot, 0.0)
        displacement = hoop + np.where(before, through, -self.overshoot)[..., None] * direction
        there = seen.ahead[..., 0]
        return np.where(there[..., None], displacement, goal), np.where(there & before, speed, 0.0)

    def _control(self, seen: DecodedObservation, acceleration: Array) -> Array:
        """Return [thrust, rate], shape (..., 2); the vertical axis has priority over the horizontal one."""
        q = self.quadrotor
        lift = np.clip(acceleration[..., 1] + q.gravity, q.thrust_min, LIFT_SHARE * q.thrust_max)
        most = np.minimum(np.sqrt(q.thrust_max**2 - lift**2), np.tan(self.tilt) * lift)
        tilt = np.arctan2(np.clip(acceleration[..., 0], -most, most), lift)
        missing = np.arctan2(np.sin(tilt - seen.theta), np.cos(tilt - seen.theta))
        return np.stack([lift / np.maximum(seen.cos, MIN_COS_TILT), self.turning * missing], axis=-1)


def _dot(one: Array, other: Array) -> Array:
    return np.sum(one * other, axis=-1)


def _norm(displacement: Array) -> Array:
    return np.hypot(displacement[..., 0], displacement[..., 1])
