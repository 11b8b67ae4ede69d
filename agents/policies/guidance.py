"""Guidance: features that a small network would have to learn to multiply and divide for.

Each gap is seen in the frame of its own axis: how far it is ahead and aside, how fast it comes nearer, and by how much
it would be missed were nothing changed - the zero-effort miss by which proportional navigation steers (Zarchan,
Tactical and Strategic Missile Guidance, 2012). The goal is seen to centimetres besides. The time is not seen: what is
optimal from a state does not depend on it, and who is late would be where nothing was ever shown.

Saved policies name the module of `Guidance`: it cannot move without orphaning them.
"""

from __future__ import annotations

from typing import Any

import torch

from agents.policies.networks import ScaledObservations
from flatgym.quadrotor import Quadrotor
from flatgym.task.observation import HOOPS_SEEN, LENGTH_UNIT, OBSERVATION_NAMES, SPEED_UNIT, squash, unsquash

VEHICLE = Quadrotor()
"""The vehicle by whose greatest thrust and weight the miss is reckoned."""
FARTHEST = 50.0
"""Greatest length [m] and speed [m/s] reckoned with; what is infinitely far is seen as this."""
SLOWEST = 0.5
"""Least closing speed by which the time to go is reckoned [m/s]."""
LATEST = 2.0
"""Greatest time to go [s]."""
NARROWEST = 0.2
"""Least half width of a gap that a miss is set against [m]."""
GAIN = 2.0
"""Factor on these features."""
PER_HOOP, TO_GOAL = 12, 7
"""Their numbers: of each hoop that is seen, and of the goal."""
TIMELESS = OBSERVATION_NAMES.index("time")
"""How many observations are passed on; the time is the last."""
HOOPS = slice(OBSERVATION_NAMES.index("hoop1_x"), OBSERVATION_NAMES.index("floor"))
"""Where the hoops stand among them."""


class Guidance(ScaledObservations):
    """What is observed but for the time, as `ScaledObservations` scales it, and what guidance laws steer by."""

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
        hoops: as they are observed, shape (..., 5).
        velocity: of the vehicle [m/s], shape (..., 2).
        up: the direction of its thrust, shape (..., 2).
    """
    way, axis, half_width = unsquashed(hoops[..., 0:2]), hoops[..., 2:4], unsquashed(hoops[..., 4]) / 2
    across = torch.stack([-axis[..., 1], axis[..., 0]], dim=-1)
    ahead, aside = dot(way, axis), dot(way, across)
    closing, drift = dot(velocity, axis), dot(velocity, across)
    forwards, sideways = dot(up, axis), dot(up, across)
    time = (ahead / closing.clamp_min(SLOWEST)).clamp(0, LATEST)
    coasting = aside - drift * time
    thrusting = coasting - (VEHICLE.thrust_max * sideways - VEHICLE.gravity * across[..., 1]) * time**2 / 2
    misses = (aside, coasting, thrusting)
    features = [squash(ahead, 0.5), *(squash(miss, 0.25) for miss in misses)]
    features += [squash(closing, 4.0), squash(drift, 2.0), forwards, sideways, time]
    features += [squash(miss, half_width.clamp_min(NARROWEST)) for miss in misses]
    return torch.stack(features, dim=-1)


def to_goal(way: torch.Tensor, velocity: torch.Tensor, up: torch.Tensor) -> torch.Tensor:
    """Return the features of the goal, shape (n, TO_GOAL): centimetres and degrees near it, and great speeds.

    Args:
        way: to the goal [m], shape (n, 2).
        velocity: of the vehicle [m/s], shape (n, 2).
        up: the direction of its thrust, shape (n, 2).
    """
    tilt = squash(up[:, 0:1], 0.2) * (up[:, 1:2] > 0)
    return torch.cat([squash(way, 0.2), squash(velocity, 0.5), tilt, squash(velocity, 12.0)], dim=-1)


def dot(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """Return the scalar products of vectors (..., 2), shape (...)."""
    return (one * other).sum(-1)


def unsquashed(seen: torch.Tensor, unit: float = LENGTH_UNIT) -> torch.Tensor:
    """Return the length [m] or speed [m/s] that is encoded as `seen`, clipped to +-FARTHEST."""
    value: torch.Tensor = unsquash(seen, unit, margin=1e-6)
    return value.clamp(-FARTHEST, FARTHEST)
