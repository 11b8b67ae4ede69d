"""Memory layout of the vehicles of a batch, and compiler options of the kernels.

The float64 array `f` holds the state of all vehicles, in blocks of BLOCK vehicles; a block is a table of ROWS rows. A
block stays in the L1 cache during all phases of a step, and the loops over its columns are vectorised. The table `s`
holds values that the phases of one step exchange, the table `t` the features of a block.

A row is named by its offset: f[k + X] with k = o + i is x of vehicle i of the block at offset o. Offsets are unsigned,
because a possibly negative index prevents vectorisation.

Arguments of the kernels: f, s, t as above; o offset of the block; first index of its first vehicle; n vehicles of the
block; m the same rounded up to whole groups; c the settings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from itertools import count, islice
from pathlib import Path

import numba
import numpy as np
from numba.extending import register_jitable

from flatgym.kernels import compilation
from flatgym.scenarios.counter_rng import mix, normal, uniform
from flatgym.scenarios.disturbances import write_disturbances
from flatgym.scenarios.layouts import uniforms_needed, write_line, write_scene, write_track
from flatgym.task.observation import OBSERVATION_NAMES

compiled = numba.njit(error_model="numpy")
"""Decorator of functions of one vehicle, for rare work."""
vectorized = numba.njit(error_model="numpy", fastmath={"contract", "arcp"})
"""Decorator of branch-free loops over a block."""
cached = compilation.cached(error_model="numpy")
"""Decorator of functions called from Python; the compiled code is stored on disk."""
for shared in (mix, uniform, normal, uniforms_needed, write_scene, write_line, write_track, write_disturbances):
    register_jitable(shared)

BLOCK = 64
"""Vehicles of a block."""


def offsets() -> Callable[[int], tuple[np.uint64, ...]]:
    """Return a function that returns the offsets of the next n rows of a table of blocks."""
    numbers = count(step=BLOCK)
    return lambda n: tuple(np.uint64(offset) for offset in islice(numbers, n))


rows = offsets()  # of `f`; kept small, because memory traffic costs more than arithmetic
X, Z, VX, VZ, THETA = rows(5)  # the state
FACTOR, PULL_X, PULL_Z, DELAY = rows(4)  # disturbances: thrust factor, external acceleration, delay
GOAL_X, GOAL_Z, COUNT, LOW_X, LOW_Z, HIGH_X, HIGH_Z = rows(7)  # the scene
AHEAD1, X1, Z1, DX1, DZ1, GAP1, WIDTH1 = rows(7)  # 1 if there is a next hoop; it, or else the goal; gap encoded
AHEAD2, X2, Z2, DX2, DZ2, _, WIDTH2 = rows(7)  # the same for the hoop after it
WAY, STEPS, PASSED, OUTCOME, POTENTIAL = rows(5)  # path length from the next hoop to the goal; episode state
ROWS = int(rows(1)[0]) // BLOCK

rows = offsets()  # of `s`
BX, BZ, BVX, BVZ, BTHETA, THRUST, RATE = rows(7)  # the state before the step, and its control
MX, MZ, MVX, MVZ, MTHETA = rows(5)  # the measured state
WAITED, BEFORE, REWARD, END = rows(4)  # outcome and potential before the step; its results
FLAG, AWAY_X, AWAY_Z = rows(3)  # flags; goal minus position
SCRATCH = int(rows(1)[0])

ROW = offsets()(len(OBSERVATION_NAMES))  # of `t`; also the offsets of consecutive rows in general
SEEN = len(ROW) * BLOCK

SPAN = np.uint64(ROWS * BLOCK)
ZERO, ONE, LANES = np.uint64(0), np.uint64(1), np.uint64(BLOCK)
GROUP = np.uint64(16)
"""Loops run over whole groups of vehicles, so that rounding does not depend on a vehicle's index in the batch."""


def sources() -> str:
    """Return a digest of all Python files of `flatgym`.

    Numba's disk cache does not detect changes in other files. The digest is part of the type of SETTINGS, and so part
    of the cache key.
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
"""Record type of the settings of an environment."""
