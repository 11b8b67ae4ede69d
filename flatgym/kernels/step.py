"""The passes over all vehicles: one step with all that follows from it, and the beginning of episodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from flatgym.kernels.layout import (
    END,
    GROUP,
    LANES,
    ONE,
    OUTCOME,
    PASSED,
    REWARD,
    ROW,
    SCRATCH,
    SEEN,
    SPAN,
    STEPS,
    WAITED,
    ZERO,
    X,
    cached,
    compiled,
    vectorized,
)
from flatgym.kernels.observation import write_observation
from flatgym.kernels.reset import find_next_hoops, start_episode
from flatgym.kernels.reward import write_potential, write_reward
from flatgym.kernels.transition import check_contacts, delay_controls, exact_step, scale_actions, write_outcome
from flatgym.task.scene import FLYING, GOAL, TIME_LIMIT


@vectorized
def write_record(f: Any, s: Any, o: Any, n: Any, first: Any, dt: float, numbers: Any) -> None:
    """Write how the flights stand; rows as in `flatgym.envs.fleet.ROWS`."""
    for j in range(5):
        for i in range(n):
            numbers[j, first + i] = f[o + X + ROW[j] + i]
    for i in range(n):
        k, lane = o + i, first + i
        numbers[5, lane], numbers[6, lane], numbers[7, lane] = f[k + STEPS], f[k + PASSED], f[k + OUTCOME]
        numbers[8, lane], numbers[9, lane], numbers[10, lane] = s[i + REWARD], s[i + END], f[k + STEPS] * dt


@vectorized
def write_counts_and_flags(f: Any, s: Any, o: Any, n: Any, first: Any, counts: Any, flags: Any) -> None:
    """Write what follows from the numbers; see `flatgym.envs.fleet.Record`."""
    for i in range(n):
        lane, end = first + i, s[i + END]
        flags[0, lane] = (end != FLYING) & (end != TIME_LIMIT)
        flags[1, lane] = end == TIME_LIMIT
        flags[2, lane] = f[o + OUTCOME + i] == GOAL
    for i in range(n):
        counts[0, first + i] = int(f[o + STEPS + i])
        counts[1, first + i] = int(f[o + PASSED + i])


@vectorized
def all_finite(actions: Any) -> bool:
    """Return whether all actions are finite."""
    wrong = 0
    for i in range(np.uint64(actions.shape[0])):
        wrong += 0 if (actions[i, 0] - actions[i, 0] == 0) & (actions[i, 1] - actions[i, 1] == 0) else 1
    return wrong == 0


@vectorized
def count_ended(s: Any, n: Any) -> int:
    """Return how many of a block have ended or begin anew."""
    busy = 0
    for i in range(n):
        busy += 1 if s[WAITED + i] + s[END + i] > 0 else 0
    return busy


@compiled
def autoreset(f: Any, s: Any, o: Any, n: Any, flag: Any, c: Any, world: Any, first: Any) -> None:
    """Begin the next episode of those of a block whose row `flag` is above zero."""
    for i in range(n):
        if s[flag + i] > 0:
            world[0][1, first + i] += ONE
            start_episode(f, s, o + i, c, first + i, world)


@compiled
def start_requested(f: Any, s: Any, o: Any, n: Any, c: Any, world: Any, first: Any, given: Any) -> None:
    """Begin an episode for those of a block whose row of `given` begins with 1.

    A row of `given` is [1 or 0, x, z, vx, vz, theta, hoops passed]; what of it is not nan replaces what was drawn.
    """
    for i in range(n):
        k, lane = o + i, first + i
        if given[lane, 0] == 0:
            continue
        start_episode(f, s, k, c, lane, world)
        for j in range(5):
            if given[lane, 1 + j] == given[lane, 1 + j]:
                f[k + X + ROW[j]] = given[lane, 1 + j]
        if given[lane, 6] == given[lane, 6]:
            f[k + PASSED] = given[lane, 6]
        find_next_hoops(f, k, world[1][lane])
        write_potential(f, s, k, ONE, c)


@cached
def advance(
    f: Any,
    ids: Any,
    hoops: Any,
    pool: Any,
    settings: Any,
    numbers: Any,
    pending: Any,
    actions: Any,
    given: Any,
    observation: Any,
    record: Any,
    counts: Any,
    flags: Any,
    ended: Any,
    final_observation: Any,
    final: Any,
) -> int:
    """Fly all vehicles one step and begin anew what has ended; or, where there are rows `given`, begin what they say.

    One function for both, because compiling it takes seconds.

    Returns:
        How many flights have ended, their numbers in `ended`; -1, and nothing is done, if an action is not finite.
    """
    c, count, over, flies = settings[0], np.uint64(ids.shape[1]), 0, given.shape[0] == 0
    s, t, world = np.zeros(SCRATCH), np.empty(SEEN, dtype=np.float32), (ids, hoops, pool, numbers)
    if flies and not all_finite(actions):
        return -1
    for first in range(ZERO, count, LANES):
        o, n = first // LANES * SPAN, min(LANES, count - first)
        m = (n + GROUP - ONE) // GROUP * GROUP
        if flies:
            scale_actions(s, m, c, actions, first)
            if c.action_delay > 0:
                delay_controls(f, s, o, n, c, pending, first)
            exact_step(f, s, o, m, c.dt)
            check_contacts(f, s, o, n, m, c, hoops, first)
            write_outcome(f, s, o, m, c)
            if c.shaped:
                write_potential(f, s, o, m, c)
            write_reward(f, s, o, m, c)
        else:
            start_requested(f, s, o, n, c, world, first, given)
        if count_ended(s, n) > 0:
            for i in range(n):
                if s[END + i] > 0:
                    ended[over] = first + i
                    over += 1
            if c.same_step:
                write_record(f, s, o, n, first, c.dt, final)
                write_observation(f, s, t, o, n, m, c, ids, first, final_observation)
            autoreset(f, s, o, n, END if c.same_step else WAITED, c, world, first)
        write_record(f, s, o, n, first, c.dt, record)
        write_counts_and_flags(f, s, o, n, first, counts, flags)
        write_observation(f, s, t, o, n, m, c, ids, first, observation)
    return over
