"""The passes over all vehicles: one step with all that follows from it, and the beginning of episodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from flatgym.kernels.beginning import aim, start
from flatgym.kernels.flight import command, delay, fly, happen, judge
from flatgym.kernels.layout import (
    END,
    LANES,
    NONE,
    ONE,
    OUTCOME,
    PASSED,
    REWARD,
    ROW,
    SPAN,
    STEPS,
    WAITS,
    X,
    cached,
    compiled,
    vectors,
)
from flatgym.kernels.sight import show
from flatgym.kernels.worth import pay, value


@vectors
def tell(f: Any, o: Any, n: Any, first: Any, record: Any) -> None:
    """Write how the flights stand; rows of `record` as in `flatgym.fleet`."""
    for j in range(5):
        for i in range(n):
            record[j, first + i] = f[o + X + ROW[j] + i]
    for i in range(n):
        k, lane = o + i, first + i
        record[5, lane], record[6, lane], record[7, lane] = f[k + STEPS], f[k + PASSED], f[k + OUTCOME]
        record[8, lane], record[9, lane] = f[k + REWARD], f[k + END]


@vectors
def stirring(f: Any, o: Any, n: Any) -> int:
    """Return how many of a block have ended or begin anew."""
    busy = 0
    for i in range(n):
        busy += 1 if f[o + WAITS + i] + f[o + END + i] > 0 else 0
    return busy


@compiled
def renew(f: Any, o: Any, n: Any, flag: Any, c: Any, ids: Any, hoops: Any, pool: Any, numbers: Any, first: Any) -> None:
    """Begin the next episode of those of a block whose row `flag` is above zero."""
    for i in range(n):
        if f[o + flag + i] > 0:
            lane = first + i
            ids[1, lane] += ONE
            start(f, o + i, c, ids[0, lane], ids[1, lane], hoops[lane], numbers, pool)


@cached
def reset(
    f: Any, ids: Any, hoops: Any, pool: Any, settings: Any, numbers: Any, given: Any, observation: Any, record: Any
) -> None:
    """Begin an episode for all whose row of `given` begins with 1; what of it is not nan replaces what was drawn.

    A row of `given` is [1 or 0, x, z, vx, vz, theta, hoops passed].
    """
    c, count = settings[0], np.uint64(ids.shape[1])
    for first in range(NONE, count, LANES):
        o, n = first // LANES * SPAN, min(LANES, count - first)
        for i in range(n):
            k, lane = o + i, first + i
            if given[lane, 0] == 0:
                continue
            start(f, k, c, ids[0, lane], ids[1, lane], hoops[lane], numbers, pool)
            for j in range(5):
                if given[lane, 1 + j] == given[lane, 1 + j]:
                    f[k + X + ROW[j]] = given[lane, 1 + j]
            if given[lane, 6] == given[lane, 6]:
                f[k + PASSED] = given[lane, 6]
            aim(f, k, hoops[lane])
            value(f, k, ONE, c)
        tell(f, o, n, first, record)
        show(f, o, n, c, ids, first, observation)


@cached
def step(
    f: Any,
    ids: Any,
    hoops: Any,
    pool: Any,
    settings: Any,
    numbers: Any,
    pending: Any,
    actions: Any,
    observation: Any,
    record: Any,
    final_observation: Any,
    final: Any,
) -> int:
    """Fly all vehicles one step and begin anew what has ended; return how many begin anew now or in the next step."""
    c, count, ended = settings[0], np.uint64(ids.shape[1]), 0
    for first in range(NONE, count, LANES):
        o, n = first // LANES * SPAN, min(LANES, count - first)
        command(f, o, c, actions, first)
        if c.action_delay > 0:
            delay(f, o, n, c, pending, first)
        fly(f, o, c.dt)
        happen(f, o, n, c, hoops, first)
        judge(f, o, c)
        value(f, o, LANES, c)
        pay(f, o, c)
        busy = stirring(f, o, n)
        if busy > 0 and c.same_step:
            tell(f, o, n, first, final)
            show(f, o, n, c, ids, first, final_observation)
            renew(f, o, n, END, c, ids, hoops, pool, numbers, first)
        elif busy > 0:
            renew(f, o, n, WAITS, c, ids, hoops, pool, numbers, first)
            for i in range(n):
                f[o + WAITS + i] = f[o + END + i]
        ended += busy
        tell(f, o, n, first, record)
        show(f, o, n, c, ids, first, observation)
    return ended
