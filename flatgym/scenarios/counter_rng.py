"""A counter-based random number generator: numbers are functions of (seed, episode, index).

The generator has no state (Salmon et al. 2011). A number is the hash of its address by SplitMix64's finalizer (Steele,
Lea and Flood 2014), applied once for each coordinate. The scenario of an episode therefore does not depend on earlier
episodes or on the number of vehicles in a batch.

The functions take uint64 arrays, or uint64 scalars when compiled.
"""

from __future__ import annotations

from typing import Any

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
STEP = np.uint64(0x9E3779B97F)
"""Odd multiplier of the index, short enough that the product does not overflow (NumPy warns of scalar overflow)."""
FIRST, SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
S27, S30, S31, S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)
UNIT = 2.0**-53

SCENE, DISTURBANCE, START, NOISE = 0, 64, 128, 192
"""First index of the numbers for goal and hoops, for disturbances, for the start state, and for sensor noise."""


def mix(x: Any) -> Any:
    """Return SplitMix64's finalizer of x: a bijection; one changed bit changes half of the bits on average."""
    x = (x ^ (x >> S30)) * FIRST
    x = (x ^ (x >> S27)) * SECOND
    return x ^ (x >> S31)


def uniform(seed: Any, episode: Any, index: Any) -> Any:
    """Return uniform numbers in [0, 1) for uint64 addresses, elementwise."""
    key = mix(mix(seed + GOLDEN) ^ (episode * GOLDEN))
    return (mix(key + index * STEP) >> S11) * UNIT


def normal(seed: Any, episode: Any, index: Any) -> Any:
    """Return standard normal numbers from the uniform numbers at `index` and `index + 1` (Box and Muller 1958)."""
    radius = np.sqrt(-2 * np.log1p(-uniform(seed, episode, index)))
    return radius * np.cos(2 * np.pi * uniform(seed, episode, index + np.uint64(1)))
