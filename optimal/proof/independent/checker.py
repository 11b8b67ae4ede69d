"""The verdict of the second checker: the longest path through the stations of each stage, and what it leaves.

    recheck("proof.json")    # True: no flight takes the claimed time

Per segment and pair of passing instants one sweep carries values back, and, where two hoops or more need it, a second
one carries them ahead; their sum at a pair is the value of the best chain through it. A pair is excluded if the mean
over both programmes plus the shared terms is negative. What is left of the passing times is the start of the next
stage; a branch is excluded once nothing is left.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.independent.chains import Chains, Integers, Invalid, Known
from optimal.proof.independent.held import HeldSweeps
from optimal.proof.independent.physics import least_flight_time, possible_windows
from optimal.proof.independent.reading import Branch, Claimed, Stage, TooLarge, all_covered, read
from optimal.proof.independent.sweeps import Sweeps

MOST_WORK = 4e10
"""Greatest work of a proof, in tilts times samples times pairs of passing instants; some minutes."""
CHUNK = 200_000
"""Values in one array of a sweep, so that it stays in the cache."""
Left = tuple[Array, Array] | None


def recheck(path: str | Path) -> bool:
    """Return whether a saved proof holds.

    Raises:
        TooLarge: if it is too large for this checker, or claims that no flight exists at all.
        ValueError: for a file that is not a proof.
    """
    claimed = read(path)
    if math.isinf(claimed.time):
        raise TooLarge("it claims that no flight exists, which this checker does not decide")
    if not claimed.branches:
        return claimed.time <= least_flight_time(claimed.scenario, claimed.tolerance) * (1 + 1e-12)
    if not claimed.time > 0 or (claimed.steps and claimed.time != claimed.steps * claimed.scenario.dt):
        return False
    if not all_covered(claimed):
        return False
    windows = possible_windows(claimed.scenario, claimed.time, claimed.tolerance)
    known = Known(windows, np.tile([0.0, claimed.time], (max(len(windows) - 1, 0), 1)))
    work = Work()
    try:
        left = after_stages(claimed, Branch(None, (), (), claimed.common), known, work)
        return left is None or all(after_stages(claimed, branch, left, work) is None for branch in claimed.branches)
    except Invalid:
        return False


class Work:
    """Counts the work of a check; TooLarge beyond MOST_WORK."""

    def __init__(self) -> None:
        self.done = 0.0

    def add(self, amount: float) -> None:
        """Add the work of a stage, before it is done."""
        self.done += amount
        if self.done > MOST_WORK:
            raise TooLarge("its windows are too wide, or its grids too fine")


def after_stages(claimed: Claimed, branch: Branch, known: Known, work: Work) -> Known | None:
    """Return what the stages of a branch leave of the passing times; None if they leave no flight."""
    for hoop, low, high in branch.passing:
        known = known.cut((hoop,), np.array([[low, high]]) * claimed.time, np.zeros((0, 2)))
    for stage in branch.stages:
        left = after_stage(claimed, branch, stage, known, work)
        if left is None:
            return None
        known = known.cut(stage.hoops, *left)
    return known


def after_stage(claimed: Claimed, branch: Branch, stage: Stage, known: Known, work: Work) -> Left:
    """Return the windows and times between hoops that one stage leaves; None if it leaves no flight."""
    chains = Chains(claimed, stage, known)
    if stage.parts and branch.winding is None:
        raise Invalid("controls are held for one winding only")
    sweeps = (HeldSweeps if stage.parts else Sweeps)(chains, branch)
    if not sweeps.possible or (chains.windows[:, 0] > chains.windows[:, 1]).any():
        return None
    pairs = [chains.pairs(i) for i in range(len(stage.hoops) + 1)]
    if any(not len(begin) for begin, _ in pairs):
        return None
    each = 2 * sweeps.reach / stage.parts if isinstance(sweeps, HeldSweeps) else 4.0
    work.add(each * sum(float((end - begin).sum()) for begin, end in pairs) * len(sweeps.index))
    found = [Paths(chains, sweeps, pairs, programme) for programme in sweeps.programmes]
    total = chains.shared + chains.rounding
    if np.mean([paths.best for paths in found]) + total < 0:
        return None
    left = [np.mean([paths.through(i) for paths in found], axis=0) + total >= 0 for i in range(len(pairs))]
    return _what_is_left(chains, pairs, left)


def _what_is_left(chains: Chains, pairs: list[tuple[Integers, Integers]], left: list[Array]) -> Left:
    """Return windows [s] and times between hoops [s] of the pairs that are left; None without any."""
    stride, dt, delay = chains.stage.stride, chains.dt, chains.delay
    windows, durations = chains.windows.copy(), []
    for i, ((begin, end), kept) in enumerate(zip(pairs, left, strict=True)):
        if not kept.any():
            return None
        for station, at in ((i, begin[kept]), (i + 1, end[kept])):
            low, high = at.min() - stride, at.max() + stride  # a cell is left if one of its ends is
            windows[station] = max(windows[station, 0], low), min(windows[station, 1], high)
        apart = (end - begin)[kept] * dt
        durations.append((max(apart.min() - 2 * chains.cell, 0.0), apart.max() + 2 * chains.cell))
    return windows[1:-1] * dt - delay, np.array(durations[1:-1]).reshape(-1, 2)


class Paths:
    """The best chains of one programme.

    Attributes:
        best: the value of the best chain, without the shared terms.
    """

    def __init__(self, chains: Chains, sweeps: Sweeps, pairs: list[tuple[Integers, Integers]], programme: int) -> None:
        self.chains, self.sweeps, self.pairs, self.programme = chains, sweeps, pairs, programme
        width, last = len(sweeps.index), len(pairs) - 1
        sizes = [(high - low) // chains.stage.stride + 1 for low, high in chains.windows]
        self._after = [np.full((size, 2, width), -np.inf) for size in sizes]
        for i in range(last, -1, -1):
            for rows in self._chunks(i):
                begin, end = (each[rows] for each in pairs[i])
                slope, terms = chains.constants(i, begin, end)
                values = sweeps.terminal(len(rows)) if i == last else self._arriving(i + 1, end, slope)
                values = sweeps.backward(i, begin, end, values, programme) + terms[:, None]
                for place in (0, 1):
                    moved = values - (slope @ chains.places[i, place])[:, None]
                    for row, at in zip(moved, self._rows(i, begin), strict=True):
                        np.maximum(self._after[i][at, place], row, out=self._after[i][at, place])
        self.best = float((self._after[0][0, 0] + sweeps.first_values()).max())
        self._before: list[Array] = []

    def _chunks(self, i: int) -> list[Integers]:
        """Return the pairs of a segment in parts, each with the longest first."""
        begin, end = self.pairs[i]
        size = max(1, CHUNK // len(self.sweeps.index))
        order = np.argsort(begin - end, kind="stable")
        return [order[k : k + size] for k in range(0, len(order), size)]

    def _rows(self, i: int, at: Integers) -> Integers:
        return np.asarray((at - self.chains.windows[i, 0]) // self.chains.stage.stride)

    def _arriving(self, i: int, at: Integers, slope: Array) -> Array:
        """Return the values of passing station i at instants, with sigma . p of the segment before, (n, width)."""
        gains = np.einsum("nk,pk->np", slope, self.chains.places[i])
        return np.asarray((self._after[i][self._rows(i, at)] + gains[:, :, None]).max(axis=1))

    def through(self, i: int) -> Array:
        """Return the value of the best chain through each pair of segment i, shape (n,)."""
        if not self._before:
            self._run_forward()
        if i < len(self.pairs) - 1:
            return self._through[i]
        rows = self._rows(i, self.pairs[i][0])
        return np.asarray((self._before[i][rows] + self._after[i][rows]).max(axis=(1, 2)))

    def _run_forward(self) -> None:
        """Carry the values of all that precedes ahead, from station to station."""
        chains, sweeps = self.chains, self.sweeps
        self._before = [np.full_like(each, -np.inf) for each in self._after]
        self._before[0][0, 0] = sweeps.first_values()
        self._through = [np.full(len(begin), -np.inf) for begin, _ in self.pairs]
        for i in range(len(self.pairs) - 1):
            for rows in self._chunks(i):
                begin, end = (each[rows] for each in self.pairs[i])
                slope, terms = chains.constants(i, begin, end)
                losses = np.einsum("nk,pk->np", slope, chains.places[i])
                values = (self._before[i][self._rows(i, begin)] - losses[:, :, None]).max(axis=1)
                values = sweeps.forward(i, begin, end, values, self.programme) + terms[:, None]
                self._through[i][rows] = (values + self._arriving(i + 1, end, slope)).max(axis=1)
                for place in (0, 1):
                    moved = values + (slope @ chains.places[i + 1, place])[:, None]
                    for row, at in zip(moved, self._rows(i + 1, end), strict=True):
                        np.maximum(self._before[i + 1][at, place], row, out=self._before[i + 1][at, place])
