"""The shaping potential: minus a rough time to go.

Along any direction d the vehicle is at best a double integrator whose acceleration lies between
-(thrust_max + g d_z) and thrust_max - g d_z, so the time in which it could cover the rest of the
way along d and stop is a lower estimate of the time to go; the largest of six directions is
taken, and a detour through hoops still ahead is added at a cruising speed.

Differences of a potential leave the optimal policy as it is (Ng, Harada and Russell 1999), however
rough it may be; a good one shortens learning, because it tells braking in time from flying on.
"""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from flatgym.task.scene import EpisodeState, Scene

CRUISE_SPEED = 5.0
"""Speed at which the detour through hoops is reckoned [m/s]."""

_ANGLES = np.arange(6) * np.pi / 6
DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Six directions over a half turn, shape (2, 6); each stands for both its ways."""


def rest_time(offset: Array, speed: Array, forward: Array, backward: Array) -> Array:
    """Return the least time in which a double integrator covers `offset` and stops [s], shape (...).

    Args:
        offset: way to go [m], shape (...).
        speed: present speed [m/s], shape (...).
        forward, backward: largest accelerations either way [m/s^2], positive, shape (...).
    """
    overshoots = 2 * offset < speed * np.abs(speed) / np.where(speed > 0, backward, forward)
    offset, speed = np.where(overshoots, -offset, offset), np.where(overshoots, -speed, speed)
    # The time already spent, had it come from rest; from rest to rest it takes sqrt(2 (1/a + 1/b) way).
    begun = speed / np.where(overshoots, backward, forward)
    return np.sqrt((1 / forward + 1 / backward) * np.maximum(2 * offset + speed * begun, 0.0)) - begun


def potential(scene: Scene, episode: EpisodeState) -> Array:
    """Return the potential [s], shape (n,): minus the time to go, 0 for flights that have ended for good.

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
    """Return the length of the polyline through the centres of the hoops ahead to the goal [m], shape (n,)."""
    way, here = np.zeros(len(scene)), episode.state[:, 0:2]
    for j in range(scene.hoop_centre.shape[1]):
        ahead = (j >= episode.hoops_passed) & (j < scene.hoop_count)
        leg = scene.hoop_centre[:, j] - here
        way += np.where(ahead, np.hypot(leg[:, 0], leg[:, 1]), 0.0)
        here = np.where(ahead[:, None], scene.hoop_centre[:, j], here)
    leg = scene.goal - here
    return way + np.hypot(leg[:, 0], leg[:, 1])
