"""The programme over the tilt for controls that are held over environment steps.

A stage is a step, or its part between the instants at which a segment begins or ends. The tilt is linear on it, from
theta to theta + c d. With I = integral of q . e(theta(t)) dt, the reward is the greater of thrust_max I, thrust_min I,
minus g h (q_a + q_b)_z / 2, plus d^2/8 thrust_max (|q_a| + |q_b|) h / 2. Here I is computed by Gauss quadrature, whose
error is below rounding for the turn of a step.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.independent.chains import Chains, Integers
from optimal.proof.independent.reading import Branch
from optimal.proof.independent.sweeps import Sweeps

NODES = 20
"""Nodes of the quadrature; exact to rounding for turns of up to a few rad."""


class HeldSweeps(Sweeps):
    """Sweeps for held controls; the tilts are those at the instants, and one programme suffices."""

    programmes = (0,)

    def __init__(self, chains: Chains, branch: Branch) -> None:
        stage, q = chains.stage, chains.claimed.scenario.quadrotor
        self.reach = int(np.ceil(q.rate_max * stage.step / chains.angle * (1 + 1e-15)))
        super().__init__(chains, branch)
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        self._nodes, self._node_weights = (nodes + 1) / 2, weights / 2

    def _reachable(self, target: int, branch: Branch) -> tuple[Integers, Integers]:
        """Return the tilts of each instant: a step turns by the reach at most, and a part of it by its share."""
        instants = np.arange(self.chains.count + 1)
        since = self._turns(instants)
        pace = self.reach / self.chains.stage.parts
        return self._bounded(target, branch, (since, since[::-1]), (instants, instants), pace)

    def _turns(self, length: Integers) -> Integers:
        """Return the greatest turn in a number of instants as a multiple of d, rounded upwards."""
        return -(-np.asarray(length) * self.reach // self.chains.stage.parts)

    def terminal(self, n: int) -> Array:
        """Return the values at the last instant, shape (n, width)."""
        values = np.tile(-self.chains.last * self.end, (n, 1))
        return self.inside(values, np.full(n, self.chains.count))

    def backward(self, i: int, begin: Integers, end: Integers, values: Array, programme: int) -> Array:  # noqa: ARG002
        """Return values at the last instants of segments, carried to their first instants; see `Sweeps`."""
        for rows, a, b in reversed(list(self._stages(begin, end))):
            after, best = self.inside(values[rows], b), np.full((len(rows), len(self.index)), -np.inf)
            for first, last, reward in self._changes(i, begin[rows], end[rows], a, b):
                np.maximum(best[:, first], after[:, last] + reward, out=best[:, first])
            values[rows] = self.inside(best, a)
        return values

    def forward(self, i: int, begin: Integers, end: Integers, values: Array, programme: int) -> Array:  # noqa: ARG002
        """Return values of all that precedes the first instants, carried to the last instants; see `Sweeps`."""
        for rows, a, b in self._stages(begin, end):
            before, best = self.inside(values[rows], a), np.full((len(rows), len(self.index)), -np.inf)
            for first, last, reward in self._changes(i, begin[rows], end[rows], a, b):
                np.maximum(best[:, last], before[:, first] + reward, out=best[:, last])
            values[rows] = self.inside(best, b)
        return values

    def _stages(self, begin: Integers, end: Integers) -> Iterator[tuple[Integers, Integers, Integers]]:
        """Yield the stages in order of time: rows of segments, and first and last instants, all of one length."""
        parts = self.chains.stage.parts
        for step in range(int(begin.min() // parts), int((end.max() - 1) // parts) + 1):
            a, b = np.maximum(begin, step * parts), np.minimum(end, (step + 1) * parts)
            for length in np.unique((b - a)[b > a]):
                rows = np.flatnonzero(b - a == length)
                yield rows, a[rows], b[rows]

    def _weights(self, i: int, begin: Integers, end: Integers, at: Integers) -> Array:
        chains, share = self.chains, ((at - begin) / (end - begin))[:, None]
        return np.asarray(chains.weights[i] * (1 - share) + chains.weights[i + 1] * share + chains.common[at])

    def _changes(
        self, i: int, begin: Integers, end: Integers, a: Integers, b: Integers
    ) -> Iterator[tuple[slice, slice, Array]]:
        """Yield each change of the tilt in stages of one length: first and last tilts, and rewards (n, w)."""
        length, u, width = int(b[0] - a[0]), self._nodes, len(self.index)
        h, most = length * self.chains.dt, int(self._turns(np.array(length)))
        q_a, q_b = self._weights(i, begin, end, a), self._weights(i, begin, end, b)
        sizes = np.hypot(q_a[:, 0], q_a[:, 1]) + np.hypot(q_b[:, 0], q_b[:, 1])
        rest = (h / 2 * (self.bulge * sizes - self.gravity * (q_a + q_b)[:, 1]))[:, None]
        early, late = h * self._node_weights * (1 - u), h * self._node_weights * u
        for change in range(-min(most, width - 1), min(most, width - 1) + 1):
            first = slice(max(0, -change), width - max(0, change))
            last = slice(max(0, change), width + min(0, change))
            turned = change * self.chains.angle * u
            cos = q_a * (early @ np.cos(turned)) + q_b * (late @ np.cos(turned))
            sin = q_a * (early @ np.sin(turned)) + q_b * (late @ np.sin(turned))
            # e(theta + phi) = (sin cos phi + cos sin phi, cos cos phi - sin sin phi)
            by_sin, by_cos = (cos[:, 0] - sin[:, 1])[:, None], (sin[:, 0] + cos[:, 1])[:, None]
            lift = by_sin * self.sin[first] + by_cos * self.cos[first]
            yield first, last, np.maximum(self.strong * lift, self.weak * lift) + rest
