"""Shared by tests of flat motions: a replay through an independent integrator."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.integrate import solve_ivp

from flatgym.quadrotor import Array
from optimal.flat.trajectory import FlatTrajectory

INPUTS = 24
"""Samples of the inputs per interval, where they are smooth, for the polynomial that replaces them."""


def replay(trajectory: FlatTrajectory) -> float:
    """Return the largest difference between a motion's states at its nodes and DOP853 under the motion's inputs."""
    nodes, inside = trajectory.breakpoints, chebyshev.chebpts1(INPUTS)
    inputs = trajectory.control(nodes[:-1, None] + np.diff(nodes)[:, None] * (inside + 1) / 2)
    polynomials = np.linalg.solve(chebyshev.chebvander(inside, INPUTS - 1), inputs)
    state, largest = trajectory.state(0.0), 0.0
    for (begin, end), polynomial in zip(itertools.pairwise(nodes), polynomials, strict=True):

        def motion(t: float, x: Array, begin: float = begin, end: float = end, c: Array = polynomial) -> Array:
            share = (2 * t - begin - end) / (end - begin)
            return trajectory.system.derivative(x, chebyshev.chebvander(share, INPUTS - 1) @ c)

        state = solve_ivp(motion, (begin, end), state, method="DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
        largest = max(largest, float(np.abs(state - trajectory.state(end)).max()))
    return largest


@pytest.fixture
def replay_error() -> Callable[[FlatTrajectory], float]:
    """The function `replay`."""
    return replay
