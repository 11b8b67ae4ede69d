"""How the vehicles of a batch lie in memory, and how the kernels are compiled.

One float64 array holds everything that flies, in blocks of BLOCK vehicles, each a table of ROWS rows: so a block stays
in the nearest cache while the phases of a step pass over it, and the loop over its columns runs in the processor's
vector registers. Offsets are unsigned, because an index that might be negative keeps the compiler from using vectors.
"""

from __future__ import annotations

import hashlib
from itertools import count, islice
from pathlib import Path

import numba
import numpy as np
from numba.extending import register_jitable

from flatgym.distributions import place
from flatgym.disturbances import affect
from flatgym.draws import mix, normal, uniform
from flatgym.task import OBSERVATION_NAMES

compiled = numba.njit(error_model="numpy")
"""For what is rare, and looked at one vehicle at a time."""
vectors = numba.njit(error_model="numpy", fastmath={"contract", "arcp"})
"""For loops over a block; no branches in them."""
cached = numba.njit(cache=True, error_model="numpy")
"""For what is called from outside; kept on disk."""
for shared in (mix, uniform, normal, place, affect):
    register_jitable(shared)

BLOCK = 32
_offsets = count(step=BLOCK)


def rows(n: int) -> tuple[np.uint64, ...]:
    """Return the offsets of the next n rows of a block."""
    return tuple(np.uint64(offset) for offset in islice(_offsets, n))


X, Z, VX, VZ, THETA = rows(5)  # the state
MX, MZ, MVX, MVZ, MTHETA = rows(5)  # the state as measured
BX, BZ, BVX, BVZ, BTHETA = rows(5)  # the state before the step
THRUST, RATE, FACTOR, PULL_X, PULL_Z, DELAY = rows(6)  # what drives it
START_X, START_Z, GOAL_X, GOAL_Z, COUNT = rows(5)  # the scene
FLOOR_Z, CEILING_Z, LOW_X, LOW_Z, HIGH_X, HIGH_Z = rows(6)
AHEAD1, X1, Z1, DX1, DZ1, GAP1, WIDTH1 = rows(7)  # is there a next hoop? the hoop, or else the goal; its gap as seen
AHEAD2, X2, Z2, DX2, DZ2, _, WIDTH2 = rows(7)  # the same of the hoop after it
WAY, STEPS, PASSED, OUTCOME = rows(4)  # the way from the next hoop on to the goal; how the flight stands
WAITS, POTENTIAL, BEFORE, FLAG = rows(4)  # whether the next step begins anew; the potential, before, and scratch
REWARD, END = rows(2)  # of the step; how the flight ended, if it did
ROW = tuple(np.uint64(i * BLOCK) for i in range(len(OBSERVATION_NAMES)))
"""Offsets of rows from another."""
OBSERVED = rows(len(ROW))[0]
ROWS = next(_offsets) // BLOCK
SPAN = np.uint64(ROWS * BLOCK)
NONE, ONE, LANES = np.uint64(0), np.uint64(1), np.uint64(BLOCK)


def sources() -> str:
    """Return a digest of this package's files.

    Numba's cache on disk does not notice when a function in another file changes. As part of the record's type the
    digest is part of the cache's key.
    """
    digest = hashlib.sha256()
    for file in sorted([*Path(__file__).parent.glob("*.py"), *Path(__file__).parents[1].glob("*.py")]):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("dt", "thrust_min", "thrust_max", "rate_max", "gravity", "radius"),
            *("position", "speed", "angle", "max_steps", "last_step"),
            *("wind", "thrust_gain", "mass", "action_delay", "sensor_noise", "share"),
        )
    ]
    + [(name, np.bool_) for name in ("shaped", "features", "drawn", "disturbed", "same_step")]
    + [(f"sources_{sources()}", np.bool_)]
)
"""What an environment is made with, as one record."""
