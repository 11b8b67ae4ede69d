"""Guidance features: products and quotients of observations that a small network represents poorly.

Each gap is expressed in the frame of its axis: distance ahead and offset, closing speed, and the zero-effort miss,
the offset at which the gap would be passed without further control. Proportional navigation uses the same quantity
(Zarchan, Tactical and Strategic Missile Guidance, 2012). The goal is added at a resolution of centimetres. The time is
removed: the optimal action does not depend on it, and a lagging vehicle would meet times without expert labels.

Stored policies pickle `Guidance` by its module path; moving or renaming the class makes them unreadable.
"""

from __future__ import annotations

from typing import Any

import torch

from agents.policies.networks import ScaledObservations
from flatgym.quadrotor import Quadrotor
from flatgym.task.observation import HOOPS_SEEN, LENGTH_UNIT, OBSERVATION_NAMES, SPEED_UNIT, squash, unsquash

VEHICLE = Quadrotor()
"""Vehicle whose largest thrust and gravity enter the predicted miss."""
MAX_VALUE = 50.0
"""Largest length [m] and speed [m/s]; infinite lengths are clipped to it."""
MIN_CLOSING_SPEED = 0.5
"""Smallest closing speed in the time to go [m/s]."""
MAX_TIME_TO_GO = 2.0
"""Largest time to go [s]."""
MIN_HALF_WIDTH = 0.2
"""Smallest half width of a gap by which a miss is normalised [m]."""
GAIN = 2.0
"""Factor on the guidance features."""
PER_HOOP, TO_GOAL = 12, 7
"""Number of features per observed hoop, and of the goal."""
TIMELESS = OBSERVATION_NAMES.index("time")
"""Number of observations without the time, which is the last."""
HOOPS = slice(OBSERVATION_NAMES.index("hoop1_x"), OBSERVATION_NAMES.index("floor"))
"""Observations of the hoops."""


class Guidance(ScaledObservations):
    """Scaled observations without the time, followed by the guidance features."""

    def __init__(self, observation_space: Any, factor: float) -> None:
        super().__init__(observation_space, factor)
        self._features_dim = TIMELESS + HOOPS_SEEN * PER_HOOP + TO_GOAL

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the features, shape (n, 49)."""
        scaled = super().forward(observations)[:, :TIMELESS]
        velocity, up = unsquashed(observations[:, 2:4], SPEED_UNIT), observations[:, 4:6]
        hoops = observations[:, HOOPS].reshape(len(observations), HOOPS_SEEN, -1)
        gaps = to_gaps(hoops, velocity[:, None], up[:, None]) * (hoops[..., -1:] > 0)
        goal = to_goal(unsquashed(observations[:, 0:2]), velocity, up)
        return torch.cat([scaled, GAIN * gaps.flatten(1), GAIN * goal], dim=1)


def to_gaps(hoops: torch.Tensor, velocity: torch.Tensor, up: torch.Tensor) -> torch.Tensor:
    """Return the features of gaps, shape (..., PER_HOOP).

    Args:
        hoops: observations of the hoops, shape (..., 5).
        velocity: velocity of the vehicle [m/s], shape (..., 2).
        up: direction of its thrust, shape (..., 2).
    """
    displacement, axis, half_width = unsquashed(hoops[..., 0:2]), hoops[..., 2:4], unsquashed(hoops[..., 4]) / 2
    across = torch.stack([-axis[..., 1], axis[..., 0]], dim=-1)
    distance, offset = dot(displacement, axis), dot(displacement, across)
    closing, drift = dot(velocity, axis), dot(velocity, across)
    forwards, sideways = dot(up, axis), dot(up, across)
    time = (distance / closing.clamp_min(MIN_CLOSING_SPEED)).clamp(0, MAX_TIME_TO_GO)
    coasting = offset - drift * time
    thrusting = coasting - (VEHICLE.thrust_max * sideways - VEHICLE.gravity * across[..., 1]) * time**2 / 2
    misses = (offset, coasting, thrusting)
    features = [squash(distance, 0.5), *(squash(miss, 0.25) for miss in misses)]
    features += [squash(closing, 4.0), squash(drift, 2.0), forwards, sideways, time]
    features += [squash(miss, half_width.clamp_min(MIN_HALF_WIDTH)) for miss in misses]
    return torch.stack(features, dim=-1)


def to_goal(displacement: torch.Tensor, velocity: torch.Tensor, up: torch.Tensor) -> torch.Tensor:
    """Return the features of the goal, shape (n, TO_GOAL): fine position and tilt, and velocity at two scales.

    Args:
        displacement: displacement to the goal [m], shape (n, 2).
        velocity: velocity of the vehicle [m/s], shape (n, 2).
        up: direction of its thrust, shape (n, 2).
    """
    tilt = squash(up[:, 0:1], 0.2) * (up[:, 1:2] > 0)
    return torch.cat([squash(displacement, 0.2), squash(velocity, 0.5), tilt, squash(velocity, 12.0)], dim=-1)


def dot(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """Return the scalar products of vectors (..., 2), shape (...)."""
    return (one * other).sum(-1)


def unsquashed(seen: torch.Tensor, unit: float = LENGTH_UNIT) -> torch.Tensor:
    """Return the length [m] or speed [m/s] that is encoded as `seen`, clipped to +-MAX_VALUE."""
    value: torch.Tensor = unsquash(seen, unit, margin=1e-6)
    return value.clamp(-MAX_VALUE, MAX_VALUE)
