"""Splines on a grid of path coordinates, as the flat program wants them: one polynomial an interval.

As published, the weights' derivative of order beta and b's of order beta - 1 are constant on every
interval: splines of those degrees with simple inner knots. Certified, both have one degree more and
double knots, so that the control of eq. (10) is linear on an interval and jumps between them. A
limit can then be kept all along an interval, where a constant control touches it at one point, and
the error falls with the square of the interval instead of linearly.

B-spline coefficients are the unknowns: continuity is exact, and coefficients within [0, 1] keep the
spline there everywhere, not at nodes only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from flatgym.quadrotor import Array


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """All splines of one degree on a grid.

    Attributes:
        nodes: where the polynomials meet, increasing from 0 to 1, shape (N + 1,).
        degree: of the polynomials.
        jumps: how many of their derivatives may jump at a node: the multiplicity of inner knots.
    """

    nodes: Array
    degree: int
    jumps: int

    @property
    def knots(self) -> Array:
        """The knots, ends repeated degree + 1 times."""
        ends = np.ones(self.degree + 1)
        return np.concatenate([ends * self.nodes[0], np.repeat(self.nodes[1:-1], self.jumps), ends * self.nodes[-1]])

    @property
    def size(self) -> int:
        """The number of coefficients."""
        return self.jumps * (len(self.nodes) - 2) + self.degree + 1

    @property
    def centres(self) -> Array:
        """The Greville abscissae: where each coefficient has most weight, shape (size,)."""
        knots = self.knots
        return np.array([knots[i + 1 : i + self.degree + 1].mean() for i in range(self.size)])

    def spline(self, coefficients: Array) -> BSpline:
        """Return the spline of coefficients of shape (size,) or (size, n)."""
        return BSpline(self.knots, coefficients, self.degree)

    def local(self, interval: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the indices of the coefficients that matter on intervals, shape (..., degree + 1)."""
        return self.jumps * interval[..., None] + np.arange(self.degree + 1)

    def basis(self, interval: NDArray[np.intp], s: Array, order: int) -> Array:
        """Return derivatives of the local basis, shape (len(s), degree + 1); s taken from inside its interval."""
        inside = np.clip(s, self.nodes[interval], np.nextafter(self.nodes[interval + 1], -1.0))
        every = BSpline(self.knots, np.eye(self.size), self.degree)(inside, nu=order)
        return np.asarray(every[np.arange(len(s))[:, None], self.local(interval)])

    def fitted(self, spline: BSpline) -> Array:
        """Return the coefficients of the nearest spline of this space; exact where the grids are nested."""
        share = (np.arange(self.degree + 3) + 0.5) / (self.degree + 3)
        s = np.concatenate([[0.0], (self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * share).ravel(), [1.0]])
        matrix = BSpline.design_matrix(s, self.knots, self.degree).toarray()
        return np.linalg.lstsq(matrix, spline(s), rcond=None)[0]
