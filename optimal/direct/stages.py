"""The order of unknowns and constraints of a program in stages.

Stage k holds the state X[k], the length h of the step before it, and the control U[k]. The first step of a phase
chooses its length as a third control; the later ones inherit it:

    (X[k+1], h[k+1]) = (step(X[k], U[k], h), h),   h = U[k, 2] in the first step of a phase, else h[k].

A stage may hold further unknowns, at its end.

Every constraint except these ties the unknowns of one stage only. That is the form that the interior-point solver
fatrop needs (`optimal.direct.stage_solver`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Stages:
    """The places of the unknowns of a program in stages.

    Attributes:
        steps: steps of each phase.
        extras: the stage of each further unknown.
    """

    steps: tuple[int, ...]
    extras: tuple[int, ...] = ()

    @cached_property
    def count(self) -> int:
        """N, the number of steps of all phases."""
        return sum(self.steps)

    @cached_property
    def firsts(self) -> Indices:
        """The first step of each phase, shape (P,)."""
        return np.cumsum((0, *self.steps[:-1]))

    @cached_property
    def begins(self) -> Indices:
        """The first index of each stage, then the number of all unknowns, shape (N+2,)."""
        sizes = np.full(self.count + 1, 8)
        sizes[self.firsts] += 1  # the step length as a control
        sizes[0] -= 1  # the first stage has no step before it
        sizes[-1] -= 2  # the last stage has no control
        np.add.at(sizes, self._extras, 1)
        return np.append(0, np.cumsum(sizes))

    @cached_property
    def states(self) -> Indices:
        """Indices of the states, shape (N+1, 5)."""
        return self.begins[:-1, None] + np.arange(5)

    @cached_property
    def arrivals(self) -> Indices:
        """Indices of the lengths of the steps before the stages 1 to N, shape (N,)."""
        return self.begins[1:-1] + 5

    @cached_property
    def controls(self) -> Indices:
        """Indices of thrust and rate, shape (N, 2)."""
        heads = np.full(self.count, 6)
        heads[0] = 5
        return (self.begins[:-2] + heads)[:, None] + np.arange(2)

    @cached_property
    def lengths(self) -> Indices:
        """Indices of the step lengths where they are chosen, at the first step of each phase, shape (P,)."""
        return self.controls[self.firsts, 1] + 1

    @cached_property
    def further(self) -> Indices:
        """Indices of the further unknowns, in the order of `extras`, shape (E,)."""
        after = [self.extras[i:].count(stage) for i, stage in enumerate(self.extras)]
        return self.begins[self._extras + 1] - np.array(after, dtype=np.int64)

    @property
    def _extras(self) -> Indices:
        return np.array(self.extras, dtype=np.int64)

    @cached_property
    def departures(self) -> Indices:
        """Indices of the length that each step uses, shape (N,)."""
        used = np.append(0, self.arrivals[:-1])
        used[self.firsts] = self.lengths
        return used

    @property
    def arcs(self) -> Indices:
        """Indices of what a step depends on, [x, z, vx, vz, theta, h, thrust, rate], shape (N, 8)."""
        return np.column_stack([self.states[:-1], self.departures, self.controls])

    @property
    def size(self) -> int:
        """The number of all unknowns."""
        return int(self.begins[-1])

    def rows(self, further: Sequence[tuple[int, list[bool]]]) -> tuple[Indices, Indices, list[bool]]:
        """Return the rows of the dynamics (N, 6), those of further constraints, and whether each row is an equation.

        Args:
            further: constraints besides the dynamics, ordered by stage: the stage, and whether each row is an equation.
        """
        equations: list[bool] = []
        gaps, rest, left = [], [], deque(further)
        for k in range(self.count + 1):
            if k < self.count:
                gaps.append(len(equations) + np.arange(6))
                equations += [True] * 6
            while left and left[0][0] == k:
                rest.append(len(equations) + np.arange(len(left[0][1])))
                equations += left.popleft()[1]
        return np.array(gaps), np.concatenate([*rest, np.zeros(0)]).astype(np.int64), equations

    def pack(self, lengths: Any, states: Any, controls: Any, further: Any = 0.0) -> Array:
        """Return the unknowns from lengths (P,), states (N+1, 5), controls (N, 2) and further unknowns (E,)."""
        unknowns = np.zeros(self.begins[-1])
        unknowns[self.states], unknowns[self.controls] = states, controls
        unknowns[self.lengths], unknowns[self.arrivals] = lengths, np.repeat(lengths, self.steps)
        unknowns[self.further] = further
        return unknowns
