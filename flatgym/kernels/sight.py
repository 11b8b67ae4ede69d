"""What is seen: the measured state, and the features of `flatgym.task.observe`."""

from __future__ import annotations

from typing import Any

import numpy as np

from flatgym.draws import NOISE, normal
from flatgym.kernels.arithmetic import sine_cosine, squash
from flatgym.kernels.layout import (
    AHEAD1,
    AHEAD2,
    CEILING_Z,
    DX1,
    DX2,
    DZ1,
    DZ2,
    FLOOR_Z,
    GOAL_X,
    GOAL_Z,
    LANES,
    MTHETA,
    MVX,
    MVZ,
    MX,
    MZ,
    OBSERVED,
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
    vectors,
)
from flatgym.task import LENGTH_UNIT, SPEED_UNIT


@vectors
def measure(f: Any, o: Any) -> None:
    """Write the states as the sensors tell them: the truth, to which noise may be added."""
    for i in range(LANES):
        k = o + i
        f[k + MX], f[k + MZ], f[k + MTHETA] = f[k + X], f[k + Z], f[k + THETA]
        f[k + MVX], f[k + MVZ] = f[k + VX], f[k + VZ]


@compiled
def err(f: Any, k: Any, noise: float, seed: Any, episode: Any) -> None:
    """Add sensor noise to what is measured of one vehicle."""
    index = np.uint64(NOISE) + np.uint64(f[k + STEPS]) * np.uint64(10)
    for j in range(5):
        f[k + MX + ROW[j]] += noise * normal(seed, episode, index + np.uint64(2 * j))


@vectors
def perceive(f: Any, o: Any, max_steps: float) -> None:
    """Write the features of `flatgym.task.observe` to the rows from OBSERVED on."""
    share = 1 / max_steps
    for i in range(LANES):
        k = o + i
        w = k + OBSERVED
        f[w] = squash(f[k + GOAL_X] - f[k + MX], LENGTH_UNIT)
        f[w + ROW[1]] = squash(f[k + GOAL_Z] - f[k + MZ], LENGTH_UNIT)
        f[w + ROW[2]] = squash(f[k + MVX], SPEED_UNIT)
        f[w + ROW[3]] = squash(f[k + MVZ], SPEED_UNIT)
        f[w + ROW[18]] = min(f[k + STEPS] * share, 1.0)
    for i in range(LANES):
        k = o + i
        w = k + OBSERVED
        f[w + ROW[4]], f[w + ROW[5]] = sine_cosine(f[k + MTHETA])
        f[w + ROW[16]] = squash(f[k + MZ] - f[k + FLOOR_Z], LENGTH_UNIT)
        f[w + ROW[17]] = squash(f[k + CEILING_Z] - f[k + MZ], LENGTH_UNIT)
    for i in range(LANES):
        k = o + i
        w = k + OBSERVED
        f[w + ROW[6]] = f[k + AHEAD1] * squash(f[k + X1] - f[k + MX], LENGTH_UNIT)
        f[w + ROW[7]] = f[k + AHEAD1] * squash(f[k + Z1] - f[k + MZ], LENGTH_UNIT)
        f[w + ROW[8]], f[w + ROW[9]], f[w + ROW[10]] = f[k + DX1], f[k + DZ1], f[k + WIDTH1]
    for i in range(LANES):
        k = o + i
        w = k + OBSERVED
        f[w + ROW[11]] = f[k + AHEAD2] * squash(f[k + X2] - f[k + MX], LENGTH_UNIT)
        f[w + ROW[12]] = f[k + AHEAD2] * squash(f[k + Z2] - f[k + MZ], LENGTH_UNIT)
        f[w + ROW[13]], f[w + ROW[14]], f[w + ROW[15]] = f[k + DX2], f[k + DZ2], f[k + WIDTH2]


@compiled
def show(f: Any, o: Any, n: Any, c: Any, ids: Any, first: int, observation: Any) -> None:
    """Write the observations of a block."""
    measure(f, o)
    if c.sensor_noise > 0:
        for i in range(n):
            err(f, o + i, c.sensor_noise, ids[0, first + i], ids[1, first + i])
    if c.features:
        perceive(f, o, c.max_steps)
        for i in range(n):
            for j in range(len(ROW)):
                observation[first + i, j] = f[o + OBSERVED + ROW[j] + i]
    else:
        for i in range(n):
            for j in range(5):
                observation[first + i, j] = f[o + MX + ROW[j] + i]
