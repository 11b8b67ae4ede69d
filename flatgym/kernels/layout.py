"""How the vehicles of a batch lie in memory, and how the kernels are compiled.

One float64 array `f` holds everything that flies, in blocks of BLOCK vehicles, each a table of ROWS rows; a block stays
in the nearest cache while the phases of a step pass over it, and the loops over its columns run in the processor's
vector registers. A smaller table `s` holds what only the phases tell each other, and `t` what is seen. A row is named
by its offset: f[k + X] with k = o + i is x of vehicle i of the block at o. Offsets are unsigned, because an index that
might be negative keeps the compiler from using vectors.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from itertools import count, islice
from pathlib import Path

import numba
import numpy as np
from numba.extending import register_jitable

from flatgym.scenarios.counter_rng import mix, normal, uniform
from flatgym.scenarios.distributions import uniforms_needed, write_scene
from flatgym.scenarios.disturbances import write_disturbances
from flatgym.task.observation import OBSERVATION_NAMES

compiled = numba.njit(error_model="numpy")
"""For what is rare, and looked at one vehicle at a time."""
vectorized = numba.njit(error_model="numpy", fastmath={"contract", "arcp"})
"""For loops over a block; no branches in them."""
cached = numba.njit(cache=True, error_model="numpy")
"""For what is called from outside; kept on disk."""
for shared in (mix, uniform, normal, uniforms_needed, write_scene, write_disturbances):
    register_jitable(shared)

BLOCK = 64


def offsets() -> Callable[[int], tuple[np.uint64, ...]]:
    """Return a function which gives the offsets of the next n rows of a table of blocks."""
    numbers = count(step=BLOCK)
    return lambda n: tuple(np.uint64(offset) for offset in islice(numbers, n))


rows = offsets()  # of what stays from step to step: it is large, and moving it takes longer than reckoning with it
X, Z, VX, VZ, THETA = rows(5)  # the state
FACTOR, PULL_X, PULL_Z, DELAY = rows(4)  # what drives it, beside the commands
GOAL_X, GOAL_Z, COUNT, LOW_X, LOW_Z, HIGH_X, HIGH_Z = rows(7)  # the scene
AHEAD1, X1, Z1, DX1, DZ1, GAP1, WIDTH1 = rows(7)  # is there a next hoop? the hoop, or else the goal; its gap as seen
AHEAD2, X2, Z2, DX2, DZ2, _, WIDTH2 = rows(7)  # the same of the hoop after it
WAY, STEPS, PASSED, OUTCOME, POTENTIAL = rows(5)  # the way from the next hoop on to the goal; how the flight stands
ROWS = int(rows(1)[0]) // BLOCK

rows = offsets()  # of what is forgotten with each block
BX, BZ, BVX, BVZ, BTHETA, THRUST, RATE = rows(7)  # the state before the step, and the commands
MX, MZ, MVX, MVZ, MTHETA = rows(5)  # the state as measured
WAITED, BEFORE, REWARD, END = rows(4)  # outcome and potential before; what the step gave
FLAG, AWAY_X, AWAY_Z = rows(3)  # marks; the way to the goal
SCRATCH = int(rows(1)[0])

ROW = offsets()(len(OBSERVATION_NAMES))  # of what is seen; and to count rows from another
SEEN = len(ROW) * BLOCK

SPAN = np.uint64(ROWS * BLOCK)
ZERO, ONE, LANES = np.uint64(0), np.uint64(1), np.uint64(BLOCK)
GROUP = np.uint64(16)
"""Vehicles are reckoned with in whole groups, so that nobody's rounding depends on his place in a batch."""


def sources() -> str:
    """Return a digest of all files of `flatgym`.

    Numba's cache on disk does not notice when a function in another file changes. As part of the record's type the
    digest is part of the cache's key.
    """
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("dt", "thrust_min", "thrust_max", "rate_max", "gravity", "radius"),
            *("start_x", "start_z", "floor", "ceiling"),
            *("position", "speed", "angle", "max_steps", "last_step"),
            *("wind", "thrust_gain", "mass", "action_delay", "sensor_noise", "share"),
        )
    ]
    + [(name, np.bool_) for name in ("shaped", "features", "drawn", "disturbed", "same_step")]
    + [(f"sources_{sources()}", np.bool_)]
)
"""What an environment is made with, as one record."""
