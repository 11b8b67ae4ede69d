"""Branch-free arithmetic for the loops over a block."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flatgym.kernels.layout import vectorized

QUARTER, QUARTER_REST = math.pi / 2, 6.123233995736766e-17
"""pi/2 as the sum of two floats."""


@vectorized
def sine_cosine(angle: float) -> Any:
    """Return sine and cosine by Taylor series about the nearest multiple of pi/2; error < 1e-15."""
    k = np.floor(angle * (1 / QUARTER) + 0.5)
    r = (angle - k * QUARTER) - k * QUARTER_REST
    q = r * r
    s = r * (1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110 * (1 - q / 156 * (1 - q / 210)))))))
    c = 1 - q / 2 * (
        1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132 * (1 - q / 182 * (1 - q / 240))))))
    )
    k -= 4 * np.floor(k / 4)
    odd = (k == 1.0) | (k == 3.0)
    sine, cosine = (c if odd else s), (s if odd else c)
    return (-sine if k >= 2.0 else sine), (-cosine if (k == 1.0) | (k == 2.0) else cosine)


@vectorized
def bessel(a: float) -> Any:
    """Return j0(a) and j1(a) for |a| <= pi by their power series; error < 1e-15."""
    q = a * a
    j0 = 1 - q / 342 * (1 - q / 420 * (1 - q / 506 * (1 - q / 600 * (1 - q / 702 * (1 - q / 812)))))
    j0 = 1 - q / 72 * (1 - q / 110 * (1 - q / 156 * (1 - q / 210 * (1 - q / 272 * j0))))
    j0 = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * j0))
    j1 = 1 - q / 378 * (1 - q / 460 * (1 - q / 550 * (1 - q / 648 * (1 - q / 754))))
    j1 = 1 - q / 88 * (1 - q / 130 * (1 - q / 180 * (1 - q / 238 * (1 - q / 304 * j1))))
    return j0, a / 3 * (1 - q / 10 * (1 - q / 28 * (1 - q / 54 * j1)))


@vectorized
def squash(one: float, other: float, unit: float) -> Any:
    """Return x / (unit + |x|) of two values with one division; `flatgym.task.observation.squash` for kernels."""
    a, b = unit + abs(one), unit + abs(other)
    share = 1 / (a * b)
    return one * b * share, other * a * share
