"""One flight of a vector environment: a reset, then steps, and the resets that the caller has to make."""

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
    check_left_alone,
    check_observations,
    check_step,
    check_unchanged,
)
from flatgym.testing.nested import exchanged, overwrite

WATCHED = 64
"""The first results of a flight, so many, and the latest are watched for changes after they were returned."""


class Flight:
    """One flight of the vector environment, call by call, each checked for the protocol.

    With `meddling`, the caller writes into all he was given, and into his actions, after each call. With `strays`,
    he hands over these actions in place of those which are to be ignored. The title tells flights apart in messages.
    """

    def __init__(
        self,
        envs: Envs,
        actions: list[Any],
        seed: int | list[int],
        title: str = "",
        meddling: bool = False,
        strays: Iterator[Any] | None = None,
    ) -> None:
        self.envs, self.n, self.mode = envs, envs.num_envs, envs.metadata["autoreset_mode"]
        self.actions, self.seed, self.title, self.meddling, self.strays = actions, seed, title, meddling, strays
        self.broken_off = False
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
                check_left_alone(self.envs, before, call)
                yield call
        for call, returned in self.watched:
            check_unchanged(call, returned, "the end of the flight")

    def _to_be_reset(self, number: int, call: Call) -> Flags:
        """Return which envs the caller resets after a step."""
        if self.mode == AutoresetMode.DISABLED:
            # Besides those that ended, every other env three times in mid-flight: the mask must be read.
            share, rest = divmod(number, max(len(self.actions) // 3, 1))
            return call.ended | ((np.arange(self.n) % 2 == share % 2) & (rest == 0))
        # All of them, once, and right after an end: an autoreset that is due must be forgotten.
        now = not self.broken_off and 2 * number >= len(self.actions) and bool(call.ended.any())
        self.broken_off |= now
        return np.full(self.n, now)

    def _reset(self, label: str, mask: Flags, seed: int | list[int] | None = None) -> Call:
        options = None if mask.all() else {"reset_mask": mask.copy()}
        observations, infos = self.envs.reset(seed=deepcopy(seed), options=options)  # type: ignore[arg-type]
        seeds = [None if seed is None else seed + i for i in range(self.n)] if not isinstance(seed, list) else seed
        rewards, flags = np.zeros(self.n), np.zeros((2, self.n), dtype=bool)
        call = self._note(label, None, list(seeds), mask, (observations, rewards, *flags, infos))
        call.rows(call.infos)
        return call

    def _step(self, label: str, actions: Any, before: Call) -> Call:
        begins = before.ended if self.mode == AutoresetMode.NEXT_STEP else np.zeros(self.n, dtype=bool)
        given = deepcopy(actions)
        if self.strays is not None and begins.any():
            given = exchanged(self.envs.single_action_space, given, next(self.strays), begins)
        handed = deepcopy(given)
        call = self._note(label, actions, [None] * self.n, begins, self.envs.step(given))
        call.compare("the actions", given, handed, who="before the step")
        check_step(call, self.keys)
        if self.mode == AutoresetMode.SAME_STEP:
            check_finals(self.envs, call)
        if self.meddling:
            overwrite(given)
        return call

    def _note(self, label: str, actions: Any, seeds: list[int | None], begins: Flags, returned: Any) -> Call:
        call = Call(self.title + label, actions, seeds, begins, *deepcopy(returned))
        if self.watched:
            check_unchanged(*self.watched[-1], label)
        if self.meddling:
            overwrite(returned)
        else:
            self.watched[WATCHED:] = [(call, returned)]
        check_observations(self.envs, call)
        return call
