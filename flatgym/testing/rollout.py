"""One rollout of a vector environment: a reset, then steps, with the resets that the caller has to make."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from flatgym.testing.calls import (
    Call,
    Envs,
    Flags,
    check_finals,
    check_observations,
    check_step,
    check_unchanged,
    check_unmasked,
)
from flatgym.testing.nested import overwrite, replace_rows

WATCHED = 64
"""The first results, this many, and the latest are checked for changes after they were returned."""


class Rollout:
    """One rollout of a vector environment; iterating yields its calls, each checked for the protocol.

    Args:
        envs: the vector environment.
        actions: batched actions, one for each step.
        seed: seed of the first reset, a number or a list of n.
        title: prefix of the messages.
        overwriting: whether to write into all returned arrays, and into the actions, after each call.
        ignored: actions that replace those which the environment must ignore.
    """

    def __init__(
        self,
        envs: Envs,
        actions: list[Any],
        seed: int | list[int],
        title: str = "",
        overwriting: bool = False,
        ignored: Iterator[Any] | None = None,
    ) -> None:
        self.envs, self.n, self.mode = envs, envs.num_envs, envs.metadata["autoreset_mode"]
        self.actions, self.seed, self.title, self.overwriting, self.ignored = (
            actions,
            seed,
            title,
            overwriting,
            ignored,
        )
        self.reset_early = False
        self.watched: list[tuple[Call, Any]] = []
        self.keys: dict[int, set[str]] = {}

    def __iter__(self) -> Iterator[Call]:
        call = self._reset("reset", np.ones(self.n, dtype=bool), self.seed)
        yield call
        for number, actions in enumerate(self.actions, 1):
            call = self._step(f"step {number}", actions, call)
            yield call
            mask = self._to_be_reset(number, call)
            if mask.any():
                before, call = call, self._reset(f"reset after step {number}", mask)
                check_unmasked(self.envs, before, call)
                yield call
        for call, returned in self.watched:
            check_unchanged(call, returned, "the end of the rollout")

    def _to_be_reset(self, number: int, call: Call) -> Flags:
        """Return which envs the caller resets after a step, shape (n,)."""
        if self.mode == AutoresetMode.DISABLED:
            # In addition to the ended envs, every other env three times within an episode: this tests the mask.
            share, rest = divmod(number, max(len(self.actions) // 3, 1))
            return call.ended | ((np.arange(self.n) % 2 == share % 2) & (rest == 0))
        # All envs, once, right after an end: the reset must cancel a pending autoreset.
        now = not self.reset_early and 2 * number >= len(self.actions) and bool(call.ended.any())
        self.reset_early |= now
        return np.full(self.n, now)

    def _reset(self, label: str, mask: Flags, seed: int | list[int] | None = None) -> Call:
        options = None if mask.all() else {"reset_mask": mask.copy()}
        observations, infos = self.envs.reset(seed=deepcopy(seed), options=options)  # type: ignore[arg-type]
        seeds = [None if seed is None else seed + i for i in range(self.n)] if not isinstance(seed, list) else seed
        rewards, flags = np.zeros(self.n), np.zeros((2, self.n), dtype=bool)
        call = self._record(label, None, list(seeds), mask, (observations, rewards, *flags, infos))
        call.rows(call.infos)
        return call

    def _step(self, label: str, actions: Any, before: Call) -> Call:
        begins = before.ended if self.mode == AutoresetMode.NEXT_STEP else np.zeros(self.n, dtype=bool)
        given = deepcopy(actions)
        if self.ignored is not None and begins.any():
            given = replace_rows(self.envs.single_action_space, given, next(self.ignored), begins)
        copy = deepcopy(given)
        call = self._record(label, actions, [None] * self.n, begins, self.envs.step(given))
        call.compare("the actions", given, copy, source="before the step")
        check_step(call, self.keys)
        if self.mode == AutoresetMode.SAME_STEP:
            check_finals(self.envs, call)
        if self.overwriting:
            overwrite(given)
        return call

    def _record(self, label: str, actions: Any, seeds: list[int | None], begins: Flags, returned: Any) -> Call:
        call = Call(self.title + label, actions, seeds, begins, *deepcopy(returned))
        if self.watched:
            check_unchanged(*self.watched[-1], label)
        if self.overwriting:
            overwrite(returned)
        else:
            self.watched[WATCHED:] = [(call, returned)]
        check_observations(self.envs, call)
        return call
