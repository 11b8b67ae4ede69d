"""The shaping potential: minus an estimate of the time to go.

Along a direction d the vehicle is at best a double integrator with acceleration between -(thrust_max + g d_z) and
thrust_max - g d_z. The minimum time of that double integrator to cover the remaining offset along d and stop is a lower
bound of the time to go. The estimate is the largest bound of six directions, plus the detour through the hoops ahead at
a cruising speed.

Potential differences leave the optimal policy unchanged (Ng, Harada and Russell 1999) for any potential. A good
potential shortens training, because it rewards braking in time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flatgym.arrays import hypot, library, like, namespace
from flatgym.task.scene import EpisodeState, Scene

CRUISE_SPEED = 5.0
"""Assumed speed on the detour through hoops [m/s]."""

_ANGLES = np.arange(6) * np.pi / 6
DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Six directions over half a turn, shape (2, 6); offsets along them have either sign."""


def rest_time(offset: Any, speed: Any, forward: Any, backward: Any) -> Any:
    """Return the minimum time of a double integrator to cover `offset` and stop [s], shape (...).

    Args:
        offset: remaining distance, signed [m], shape (...).
        speed: current velocity [m/s], shape (...).
        forward, backward: maximum accelerations in either direction [m/s^2], positive, shape (...).
    """
    xp = namespace(offset, speed)
    overshoots = 2 * offset < speed * xp.abs(speed) / xp.where(speed > 0, backward, forward)
    offset, speed = xp.where(overshoots, -offset, offset), xp.where(overshoots, -speed, speed)
    # `begun` is the time from rest to the current speed. From rest to rest the time is sqrt(2 (1/a + 1/b) distance).
    begun = speed / xp.where(overshoots, backward, forward)
    way = 2 * offset + speed * begun
    moves = way > 0  # the root of 0 has no gradient
    return xp.sqrt(xp.where(moves, (1 / forward + 1 / backward) * way, xp.ones_like(way))) * moves - begun


def potential(scene: Scene, episode: EpisodeState) -> Any:
    """Return the potential [s], shape (n,): minus the estimated time to go, 0 for terminated episodes.

    Args:
        scene: the scenarios of n vehicles.
        episode: where they stand.
    """
    xp, quadrotor = namespace(episode.state), scene.quadrotor
    position, velocity = episode.state[:, 0:2], episode.state[:, 2:4]
    offset, directions = scene.goal - position, xp.asarray(DIRECTIONS, **like(position))
    pull = quadrotor.gravity * directions[1]
    times = rest_time(
        _along(offset, directions),
        _along(velocity, directions),
        quadrotor.thrust_max - pull,
        quadrotor.thrust_max + pull,
    )
    detour = remaining_path_length(scene, episode) - hypot(offset[:, 0], offset[:, 1])
    estimate = -xp.max(times, axis=1) - detour / CRUISE_SPEED
    return xp.where(episode.terminated, xp.zeros_like(estimate), estimate)


def _along(vectors: Any, directions: Any) -> Any:
    """Return the components of vectors (n, 2) along directions (2, 6), shape (n, 6)."""
    if library(vectors) == "numpy":  # other libraries may round products of matrices to less than their precision
        return vectors @ directions
    return vectors[:, :1] * directions[0] + vectors[:, 1:] * directions[1]


def remaining_path_length(scene: Scene, episode: EpisodeState) -> Any:
    """Return the length of the polyline through the hoop centres ahead to the goal [m], shape (n,)."""
    xp, here = namespace(episode.state), episode.state[:, 0:2]
    way = xp.zeros_like(here[:, 0])
    for j in range(scene.hoop_centre.shape[1]):
        ahead = (j >= episode.hoops_passed) & (j < scene.hoop_count)
        leg = scene.hoop_centre[:, j] - here
        way = way + xp.where(ahead, hypot(leg[:, 0], leg[:, 1]), xp.zeros_like(way))
        here = xp.where(ahead[:, None], scene.hoop_centre[:, j], here)
    leg = scene.goal - here
    return way + hypot(leg[:, 0], leg[:, 1])
