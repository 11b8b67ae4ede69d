"""Observations: the measured state, and the features of `flatgym.task.observe`."""

from __future__ import annotations

from typing import Any

import numpy as np

from flatgym.kernels.arithmetic import sine_cosine, squash
from flatgym.kernels.layout import (
    AHEAD1,
    AHEAD2,
    DX1,
    DX2,
    DZ1,
    DZ2,
    GOAL_X,
    GOAL_Z,
    MTHETA,
    MVX,
    MVZ,
    MX,
    MZ,
    ROW,
    STEPS,
    THETA,
    VX,
    VZ,
    WIDTH1,
    WIDTH2,
    X1,
    X2,
    Z1,
    Z2,
    X,
    Z,
    compiled,
    vectorized,
)
from flatgym.scenarios.counter_rng import NOISE, normal
from flatgym.task.observation import LENGTH_UNIT, SPEED_UNIT


@vectorized
def measure(f: Any, s: Any, o: Any, m: Any) -> None:
    """Write the measured states of a block, without noise."""
    for i in range(m):
        k = o + i
        s[i + MX], s[i + MZ], s[i + MTHETA] = f[k + X], f[k + Z], f[k + THETA]
        s[i + MVX], s[i + MVZ] = f[k + VX], f[k + VZ]


@compiled
def add_noise(f: Any, s: Any, k: Any, i: Any, noise: float, seed: Any, episode: Any) -> None:
    """Add sensor noise to the measured state of one vehicle."""
    index = np.uint64(NOISE) + np.uint64(f[k + STEPS]) * np.uint64(10)
    for j in range(5):
        s[i + MX + ROW[j]] += noise * normal(seed, episode, index + np.uint64(2 * j))


@vectorized
def write_features(f: Any, s: Any, t: Any, o: Any, m: Any, c: Any) -> None:
    """Write the features of `flatgym.task.observe` of a block to `t`."""
    share, floor, ceiling = 1 / c.max_steps, c.floor, c.ceiling
    for i in range(m):
        k = o + i
        x, z = s[i + MX], s[i + MZ]
        t[i], t[i + ROW[1]] = squash(f[k + GOAL_X] - x, f[k + GOAL_Z] - z, LENGTH_UNIT)
        t[i + ROW[2]], t[i + ROW[3]] = squash(s[i + MVX], s[i + MVZ], SPEED_UNIT)
        t[i + ROW[4]], t[i + ROW[5]] = sine_cosine(s[i + MTHETA])
        t[i + ROW[16]], t[i + ROW[17]] = squash(z - floor, ceiling - z, LENGTH_UNIT)
        t[i + ROW[18]] = min(f[k + STEPS] * share, 1.0)
    for i in range(m):
        k = o + i
        x, z = s[i + MX], s[i + MZ]
        hoop_x, hoop_z = squash(f[k + X1] - x, f[k + Z1] - z, LENGTH_UNIT)
        t[i + ROW[6]], t[i + ROW[7]] = f[k + AHEAD1] * hoop_x, f[k + AHEAD1] * hoop_z
        t[i + ROW[8]], t[i + ROW[9]], t[i + ROW[10]] = f[k + DX1], f[k + DZ1], f[k + WIDTH1]
        hoop_x, hoop_z = squash(f[k + X2] - x, f[k + Z2] - z, LENGTH_UNIT)
        t[i + ROW[11]], t[i + ROW[12]] = f[k + AHEAD2] * hoop_x, f[k + AHEAD2] * hoop_z
        t[i + ROW[13]], t[i + ROW[14]], t[i + ROW[15]] = f[k + DX2], f[k + DZ2], f[k + WIDTH2]


@compiled
def write_observation(
    f: Any, s: Any, t: Any, o: Any, n: Any, m: Any, c: Any, ids: Any, first: int, observation: Any
) -> None:
    """Write the observations of a block, features or measured states, to rows of `observation`."""
    measure(f, s, o, m)
    if c.sensor_noise > 0:
        for i in range(n):
            add_noise(f, s, o + i, i, c.sensor_noise, ids[0, first + i], ids[1, first + i])
    if c.features:
        write_features(f, s, t, o, m, c)
        for i in range(n):
            for j in range(len(ROW)):
                observation[first + i, j] = t[ROW[j] + i]
    else:
        for i in range(n):
            for j in range(5):
                observation[first + i, j] = s[MX + ROW[j] + i]
