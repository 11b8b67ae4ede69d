"""Start of an episode: sampling from its seed and number, and the initial state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flatgym.kernels.layout import (
    AHEAD1,
    AHEAD2,
    COUNT,
    DELAY,
    DX1,
    DZ1,
    FACTOR,
    GAP1,
    GOAL_X,
    GOAL_Z,
    HIGH_X,
    HIGH_Z,
    LOW_X,
    LOW_Z,
    ONE,
    OUTCOME,
    PASSED,
    PULL_X,
    PULL_Z,
    ROW,
    STEPS,
    THETA,
    VX,
    VZ,
    WAY,
    WIDTH1,
    X1,
    Z1,
    X,
    Z,
    compiled,
)
from flatgym.kernels.reward import write_potential
from flatgym.scenarios.counter_rng import DISTURBANCE, SCENE, START, uniform
from flatgym.scenarios.disturbances import write_disturbances
from flatgym.scenarios.layouts import PER_HOOP, PLACED, uniforms_needed, write_scene
from flatgym.scenarios.scenario import BOUNDS_MARGIN
from flatgym.task.observation import LENGTH_UNIT
from flatgym.task.scene import FLYING


@compiled
def start_episode(f: Any, s: Any, k: Any, c: Any, lane: Any, world: Any) -> None:
    """Start an episode: sample scene and disturbances, set the initial state, compute its potential."""
    ids, all_hoops, pool, distribution = world
    seed, episode, hoops = ids[0, lane], ids[1, lane], all_hoops[lane]
    if c.drawn:
        sample_scene(f, k, seed, episode, hoops, distribution)
    f[k + FACTOR], f[k + PULL_X], f[k + PULL_Z], f[k + DELAY] = 1.0, 0.0, -c.gravity, 0.0
    if c.disturbed:
        sample_disturbances(f, k, c, seed, episode)
    f[k + X], f[k + Z], f[k + VX], f[k + VZ], f[k + THETA] = c.start_x, c.start_z, 0.0, 0.0, 0.0
    f[k + STEPS], f[k + PASSED], f[k + OUTCOME] = 0.0, 0.0, FLYING
    if pool.shape[0] > 0 and uniform(seed, episode, np.uint64(START)) < c.share:
        row = int(uniform(seed, episode, np.uint64(START + 1)) * pool.shape[0])
        for j in range(5):
            f[k + X + ROW[j]] = pool[row, j]
        f[k + PASSED] = pool[row, 5]
    find_next_hoops(f, k, hoops)
    write_potential(f, s, k, ONE, c)


@compiled
def sample_scene(f: Any, k: Any, seed: Any, episode: Any, hoops: Any, distribution: Any) -> None:
    """Sample goal and hoops, and set the bounds as `Scenario.bounds` does."""
    u, scene = np.empty(uniforms_needed(hoops.shape[0])), np.empty(PLACED + PER_HOOP * hoops.shape[0])
    for i in range(u.size):
        u[i] = uniform(seed, episode, np.uint64(SCENE + i))
    write_scene(u, distribution, scene)
    f[k + GOAL_X], f[k + GOAL_Z], f[k + COUNT] = scene[0], scene[1], scene[2]
    low_x, high_x = min(0.0, scene[0]), max(0.0, scene[0])
    low_z, high_z = min(0.0, scene[1]), max(0.0, scene[1])
    for j in range(int(scene[2])):
        r = PLACED + PER_HOOP * j
        x, z, angle = scene[r], scene[r + 1], scene[r + 2]
        hoops[j, 0], hoops[j, 1], hoops[j, 4] = x, z, scene[r + 3]
        hoops[j, 2], hoops[j, 3] = math.cos(angle), math.sin(angle)
        low_x, high_x, low_z, high_z = min(low_x, x), max(high_x, x), min(low_z, z), max(high_z, z)
    f[k + LOW_X], f[k + HIGH_X] = low_x - BOUNDS_MARGIN, high_x + BOUNDS_MARGIN
    f[k + LOW_Z], f[k + HIGH_Z] = low_z - BOUNDS_MARGIN, high_z + BOUNDS_MARGIN


@compiled
def sample_disturbances(f: Any, k: Any, c: Any, seed: Any, episode: Any) -> None:
    """Sample the disturbances of an episode."""
    u, drawn = np.empty(5), np.empty(4)
    for i in range(5):
        u[i] = uniform(seed, episode, np.uint64(DISTURBANCE + i))
    write_disturbances(u, c.wind, c.thrust_gain, c.mass, c.action_delay, drawn)
    f[k + FACTOR], f[k + PULL_X], f[k + PULL_Z], f[k + DELAY] = drawn[0], drawn[1], drawn[2] - c.gravity, drawn[3]


@compiled
def find_next_hoops(f: Any, k: Any, hoops: Any) -> None:
    """Write the next two hoops, and the length of the polyline from the first of them to the goal."""
    j, count = int(f[k + PASSED]), int(f[k + COUNT])
    for i in range(2):
        r = k + np.uint64(i) * (AHEAD2 - AHEAD1)
        f[r + AHEAD1] = 1.0 if j + i < count else 0.0
        if j + i < count:
            f[r + X1], f[r + Z1], f[r + GAP1] = hoops[j + i, 0], hoops[j + i, 1], hoops[j + i, 4]
            f[r + DX1], f[r + DZ1] = hoops[j + i, 2], hoops[j + i, 3]
        else:
            f[r + X1], f[r + Z1] = f[k + GOAL_X], f[k + GOAL_Z]
            f[r + DX1], f[r + DZ1], f[r + GAP1] = 0.0, 0.0, 0.0
        f[r + WIDTH1] = f[r + GAP1] / (LENGTH_UNIT + f[r + GAP1])
    x, z, way = f[k + X1], f[k + Z1], 0.0
    for i in range(j + 1, count):
        way += math.hypot(hoops[i, 0] - x, hoops[i, 1] - z)
        x, z = hoops[i, 0], hoops[i, 1]
    f[k + WAY] = way + math.hypot(f[k + GOAL_X] - x, f[k + GOAL_Z] - z)
