"""Spline spaces of the flat program: one polynomial on each interval of a grid of path coordinates.

As published, the derivative of order beta of the weights and the derivative of order beta - 1 of b are constant on
every interval: splines of degree beta and beta - 1 with simple inner knots. The certified discretisation raises both
degrees by one and uses double inner knots. The control of eq. (10) is then linear on an interval and may jump at
nodes. A linear control can stay at a limit along a whole interval, whereas a constant control touches it at one point,
and the error decreases with the square of the interval length instead of linearly.

The unknowns are B-spline coefficients. Continuity then holds exactly, and coefficients in [0, 1] keep the spline in
[0, 1] everywhere, not only at nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from flatgym.quadrotor import Array


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """The space of splines of one degree on a grid.

    Attributes:
        nodes: grid nodes, increasing from 0 to 1, shape (N + 1,).
        degree: degree of the polynomials.
        multiplicity: multiplicity of the inner knots: how many derivatives may jump at a node.
    """

    nodes: Array
    degree: int
    multiplicity: int

    @property
    def knots(self) -> Array:
        """The knot vector, both ends repeated degree + 1 times."""
        ends = np.ones(self.degree + 1)
        return np.concatenate(
            [ends * self.nodes[0], np.repeat(self.nodes[1:-1], self.multiplicity), ends * self.nodes[-1]]
        )

    @property
    def size(self) -> int:
        """The number of coefficients."""
        return self.multiplicity * (len(self.nodes) - 2) + self.degree + 1

    @property
    def centres(self) -> Array:
        """The Greville abscissae of the coefficients, shape (size,)."""
        knots = self.knots
        return np.array([knots[i + 1 : i + self.degree + 1].mean() for i in range(self.size)])

    def spline(self, coefficients: Array) -> BSpline:
        """Return the spline of coefficients of shape (size,) or (size, n)."""
        return BSpline(self.knots, coefficients, self.degree)

    def local(self, interval: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the indices of the coefficients that are active on intervals, shape (..., degree + 1)."""
        return self.multiplicity * interval[..., None] + np.arange(self.degree + 1)

    def basis(self, interval: NDArray[np.intp], s: Array, order: int) -> Array:
        """Return derivatives of the active basis functions, shape (len(s), degree + 1).

        Args:
            interval: index of the interval of each s, shape (len(s),).
            s: path coordinates; at the right end of an interval the derivative from inside is returned.
            order: order of the derivative.
        """
        inside = np.clip(s, self.nodes[interval], np.nextafter(self.nodes[interval + 1], -1.0))
        # The active functions of an interval are neighbours, so each remainder of their index occurs once.
        active = self.degree + 1
        remainders = np.eye(active)[np.arange(self.size) % active]
        values = self.spline(remainders)(inside, nu=order)
        return np.asarray(np.take_along_axis(values, self.local(interval) % active, axis=1))

    def fitted(self, spline: BSpline) -> Array:
        """Return the coefficients of the least-squares fit to a spline. The fit is exact on nested grids."""
        share = (np.arange(self.degree + 3) + 0.5) / (self.degree + 3)
        s = np.concatenate([[0.0], (self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * share).ravel(), [1.0]])
        return self.nearest(s, spline(s))

    def nearest(self, s: Array, values: Array) -> Array:
        """Return the coefficients of the least-squares fit to values (n, ...) at path coordinates (n,)."""
        if not values.size:  # the weights of a single path, which SciPy does not accept
            return np.zeros((self.size, *values.shape[1:]))
        return np.asarray(make_lsq_spline(s, values, self.knots, self.degree, method="qr").c)
