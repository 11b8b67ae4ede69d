"""The shaping potential: minus an estimate of the time to go.

Along a direction d the vehicle is at best a double integrator with acceleration between -(thrust_max + g d_z) and
thrust_max - g d_z. The minimum time of that double integrator to cover the remaining offset along d and stop is a lower
bound of the time to go. The estimate is the largest bound of six directions, plus the detour through the hoops ahead at
a cruising speed.

Potential differences leave the optimal policy unchanged (Ng, Harada and Russell 1999) for any potential. A good
potential shortens training, because it rewards braking in time.
"""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from flatgym.task.scene import EpisodeState, Scene

CRUISE_SPEED = 5.0
"""Assumed speed on the detour through hoops [m/s]."""

_ANGLES = np.arange(6) * np.pi / 6
DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Six directions over half a turn, shape (2, 6); offsets along them have either sign."""


def rest_time(offset: Array, speed: Array, forward: Array, backward: Array) -> Array:
    """Return the minimum time of a double integrator to cover `offset` and stop [s], shape (...).

    Args:
        offset: remaining distance, signed [m], shape (...).
        speed: current velocity [m/s], shape (...).
        forward, backward: maximum accelerations in either direction [m/s^2], positive, shape (...).
    """
    overshoots = 2 * offset < speed * np.abs(speed) / np.where(speed > 0, backward, forward)
    offset, speed = np.where(overshoots, -offset, offset), np.where(overshoots, -speed, speed)
    # `begun` is the time from rest to the current speed. From rest to rest the time is sqrt(2 (1/a + 1/b) distance).
    begun = speed / np.where(overshoots, backward, forward)
    return np.sqrt((1 / forward + 1 / backward) * np.maximum(2 * offset + speed * begun, 0.0)) - begun


def potential(scene: Scene, episode: EpisodeState) -> Array:
    """Return the potential [s], shape (n,): minus the estimated time to go, 0 for terminated episodes.

    Args:
        scene: the scenarios of n vehicles.
        situation: where they stand.
    """
    position, velocity, quadrotor = episode.state[:, 0:2], episode.state[:, 2:4], scene.quadrotor
    offset, pull = scene.goal - position, quadrotor.gravity * DIRECTIONS[1]
    times = rest_time(
        offset @ DIRECTIONS, velocity @ DIRECTIONS, quadrotor.thrust_max - pull, quadrotor.thrust_max + pull
    )
    detour = remaining_path_length(scene, episode) - np.hypot(offset[:, 0], offset[:, 1])
    return np.where(episode.terminated, 0.0, -times.max(axis=1) - detour / CRUISE_SPEED)


def remaining_path_length(scene: Scene, episode: EpisodeState) -> Array:
    """Return the length of the polyline through the hoop centres ahead to the goal [m], shape (n,)."""
    way, here = np.zeros(len(scene)), episode.state[:, 0:2]
    for j in range(scene.hoop_centre.shape[1]):
        ahead = (j >= episode.hoops_passed) & (j < scene.hoop_count)
        leg = scene.hoop_centre[:, j] - here
        way += np.where(ahead, np.hypot(leg[:, 0], leg[:, 1]), 0.0)
        here = np.where(ahead[:, None], scene.hoop_centre[:, j], here)
    leg = scene.goal - here
    return way + np.hypot(leg[:, 0], leg[:, 1])
