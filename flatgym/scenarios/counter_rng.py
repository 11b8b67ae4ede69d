"""Random numbers as a function of (seed, episode, index): no state, any order, the same everywhere.

A counter-based generator in the sense of Salmon et al. (2011): a number is the hash of its address, by
SplitMix64's finalizer (Steele, Lea and Flood 2014) applied once a coordinate. So the scene of an
episode is known without having drawn those before it, in one environment or in thousands alike.

The functions take uint64 arrays, or uint64 scalars when compiled.
"""

from __future__ import annotations

from typing import Any

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
STEP = np.uint64(0x9E3779B97F)
"""Odd, and so short that an index times it does not overflow, of which NumPy warns for scalars."""
FIRST, SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
S27, S30, S31, S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)
UNIT = 2.0**-53

SCENE, DISTURBANCE, START, NOISE = 0, 64, 128, 192
"""First index of the numbers drawn for hoops and goal, for disturbances, for the start, and for sensor noise."""


def mix(x: Any) -> Any:
    """Return SplitMix64's finalizer of x: a bijection that changes half the bits for each bit changed."""
    x = (x ^ (x >> S30)) * FIRST
    x = (x ^ (x >> S27)) * SECOND
    return x ^ (x >> S31)


def uniform(seed: Any, episode: Any, index: Any) -> Any:
    """Return numbers uniform in [0, 1) for addresses of uint64, elementwise."""
    key = mix(mix(seed + GOLDEN) ^ (episode * GOLDEN))
    return (mix(key + index * STEP) >> S11) * UNIT


def normal(seed: Any, episode: Any, index: Any) -> Any:
    """Return standard normal numbers, each from the uniform numbers at `index` and the next (Box and Muller 1958)."""
    radius = np.sqrt(-2 * np.log1p(-uniform(seed, episode, index)))
    return radius * np.cos(2 * np.pi * uniform(seed, episode, index + np.uint64(1)))
