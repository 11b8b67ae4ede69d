"""The programme over the tilt for controls that may change at any time, for many segments at once.

Sample k of a segment has the reward dt (max over f of q . (f e(theta) - g e_z) + d^2/8 thrust_max |q|) with the weight
q at t_k (programme 0) or t_(k+1) (programme 1). The tilts of consecutive samples are neighbouring multiples of d, or
equal.
"""

from __future__ import annotations

import math

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.independent.chains import Chains, Integers
from optimal.proof.independent.physics import MARGIN
from optimal.proof.independent.reading import Branch


class Sweeps:
    """The tilts of a class of flights on a grid, and sweeps over them.

    Attributes:
        programmes: the programmes whose mean bounds the reward.
        low, high: least and greatest multiple of d of each sample, shape (N,); of each instant for held controls.
        index: the multiples of d of all tilts, shape (width,).
        start, end: distance of each tilt to 0 and to the winding, as multiples of d.
        circular: whether the tilts are one whole turn, closed to a circle.
    """

    programmes: tuple[int, ...] = (0, 1)

    def __init__(self, chains: Chains, branch: Branch) -> None:
        self.chains, stage = chains, chains.stage
        self.circular = branch.winding is None
        turn = stage.turn
        if branch.winding is None:
            self.index = np.arange(turn)
            self.low, self.high = np.zeros(stage.steps, np.int64), np.full(stage.steps, turn - 1)
            self.start = np.minimum(self.index, turn - self.index).astype(np.float64)
            self.end = self.start
        else:
            target = branch.winding * turn
            self.low, self.high = self._reachable(target, branch)
            self.index = np.arange(self.low.min(), max(self.high.max(), self.low.min()) + 1)
            self.start, self.end = np.abs(self.index) * 1.0, np.abs(self.index - target) * 1.0
        angle = chains.angle * ((self.index + turn // 2) % turn - turn // 2)
        self.sin, self.cos = np.sin(angle), np.cos(angle)
        q = chains.claimed.scenario.quadrotor
        self.strong, self.weak, self.gravity = q.thrust_max, q.thrust_min, q.gravity
        self.bulge = chains.angle**2 / 8 * q.thrust_max

    @property
    def possible(self) -> bool:
        """Whether every sample has a tilt."""
        return bool((self.low <= self.high).all())

    def _slack(self) -> int:
        """Return the deviation of the last tilt from whole turns as a multiple of d, rounded upwards."""
        near = self.chains.claimed.tolerance
        return math.ceil((near.angle if near else 0.0) / self.chains.angle)

    def _reachable(self, target: int, branch: Branch) -> tuple[Integers, Integers]:
        """Return the tilts of each sample: it lies between the instants k and k + 1, and a time step turns by d."""
        count = self.chains.count
        early, late = np.arange(count), np.arange(1, count + 1)
        return self._bounded(target, branch, (late, count - early), (early, late), 1.0)

    def _bounded(
        self,
        target: int,
        branch: Branch,
        turns: tuple[Integers, Integers],
        instants: tuple[Integers, Integers],
        pace: float,
    ) -> tuple[Integers, Integers]:
        """Return the least and greatest tilt of each sample as multiples of d.

        Args:
            target: the last tilt.
            branch: its held tilts are bounds too.
            turns: greatest turns since the start, and until the end.
            instants: those between which each sample lies.
            pace: greatest turn in the time between two instants.
        """
        chains, spare, (since, until), (early, late) = self.chains, self._slack(), turns, instants
        low = np.maximum(-since, target - spare - until).astype(np.float64)
        high = np.minimum(since, target + spare + until).astype(np.float64)
        for share, least, greatest in branch.held:
            at = chains.count - (1 - share) * chains.claimed.time / chains.dt
            turned = pace * np.maximum(np.abs(early - at), np.abs(late - at)) + MARGIN * chains.count
            low = np.maximum(low, np.floor(least / chains.angle - turned))
            high = np.minimum(high, np.ceil(greatest / chains.angle + turned))
        return low.astype(np.int64), high.astype(np.int64)

    def inside(self, values: Array, at: Integers) -> Array:
        """Return values (n, width) with -inf outside the tilts of the samples or instants `at`, shape (n,)."""
        if self.circular:
            return values
        outside = (self.index < self.low[at][:, None]) | (self.index > self.high[at][:, None])
        values[outside] = -np.inf
        return values

    def first_values(self) -> Array:
        """Return the penalty of the first tilt, -inf where it cannot be, shape (width,)."""
        return self.inside(-self.chains.first * self.start[None], np.zeros(1, np.int64))[0]

    def terminal(self, n: int) -> Array:
        """Return the values after the last sample, shape (n, width)."""
        return np.zeros((n, len(self.index)))

    def backward(self, i: int, begin: Integers, end: Integers, values: Array, programme: int) -> Array:
        """Return values (n, width) at the last instants of segments from station i, carried to their first samples."""
        chains, longest = self.chains, int((end - begin).max())
        for back in range(1, longest + 1):
            n = int(np.searchsorted(begin - end, -back, side="right"))  # segments are sorted, the longest first
            k = end[:n] - back
            reward = self._rewards(i, begin[:n], end[:n], k, programme)
            if k[0] == chains.count - 1:
                values[:n] = reward - chains.last * self.end
            else:
                values[:n] = reward + self._neighbours(values[:n])
            self.inside(values[:n], k)
        return values

    def forward(self, i: int, begin: Integers, end: Integers, values: Array, programme: int) -> Array:
        """Return values (n, width) of all that precedes the first samples, carried to the last instants."""
        for ahead in range(int((end - begin).max())):
            n = int(np.searchsorted(begin - end, -ahead - 1, side="right"))
            k = begin[:n] + ahead
            inner = self.inside(values[:n] + self._rewards(i, begin[:n], end[:n], k, programme), k)
            values[:n] = self._neighbours(inner)
        return values

    def _rewards(self, i: int, begin: Integers, end: Integers, k: Integers, programme: int) -> Array:
        """Return the rewards of samples k of segments, for all tilts, shape (n, width)."""
        chains, at = self.chains, k + programme
        share = ((at - begin) / (end - begin))[:, None]
        left, right = chains.weights[i], chains.weights[i + 1]
        q = chains.dt * (left * (1 - share) + right * share + chains.common[at])
        lift = q[:, :1] * self.sin + q[:, 1:] * self.cos
        rest = self.bulge * np.hypot(q[:, 0], q[:, 1]) - self.gravity * q[:, 1]
        return np.maximum(self.strong * lift, self.weak * lift) + rest[:, None]

    def _neighbours(self, values: Array) -> Array:
        """Return the greatest of each value and its two neighbours."""
        found = values.copy()
        np.maximum(found[:, 1:], values[:, :-1], out=found[:, 1:])
        np.maximum(found[:, :-1], values[:, 1:], out=found[:, :-1])
        if self.circular:
            np.maximum(found[:, 0], values[:, -1], out=found[:, 0])
            np.maximum(found[:, -1], values[:, 0], out=found[:, -1])
        return found
