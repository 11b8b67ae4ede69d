"""The entry point `advance`: one step of all vehicles with autoreset, or the start of requested episodes."""

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
    """Write the numbers of a block; rows as in `flatgym.envs.fleet.ROWS`."""
    for j in range(5):
        for i in range(n):
            numbers[j, first + i] = f[o + X + ROW[j] + i]
    for i in range(n):
        k, lane = o + i, first + i
        numbers[5, lane], numbers[6, lane], numbers[7, lane] = f[k + STEPS], f[k + PASSED], f[k + OUTCOME]
        numbers[8, lane], numbers[9, lane], numbers[10, lane] = s[i + REWARD], s[i + END], f[k + STEPS] * dt


@vectorized
def write_counts_and_flags(f: Any, s: Any, o: Any, n: Any, first: Any, counts: Any, flags: Any) -> None:
    """Write counts and flags of a block; see `flatgym.envs.fleet.Record`."""
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
    """Return how many vehicles of a block have ended their episode or are to be reset."""
    count = 0
    for i in range(n):
        count += 1 if s[WAITED + i] + s[END + i] > 0 else 0
    return count


@compiled
def autoreset(f: Any, s: Any, o: Any, n: Any, flag: Any, c: Any, world: Any, first: Any) -> None:
    """Start the next episode of the vehicles of a block whose row `flag` is above zero."""
    for i in range(n):
        if s[flag + i] > 0:
            world[0][1, first + i] += ONE
            start_episode(f, s, o + i, c, first + i, world)


@compiled
def start_requested(f: Any, s: Any, o: Any, n: Any, c: Any, world: Any, first: Any, given: Any) -> None:
    """Start an episode for the vehicles of a block whose row of `given` starts with 1.

    A row of `given` is [1 or 0, x, z, vx, vz, theta, hoops passed], shape (7,). Entries that are not nan replace those
    of the episode's own start.
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
    distribution: Any,
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
    """Advance all vehicles by one step with autoreset; or, if `given` has rows, start the episodes they request.

    One function does both, because each compiled function costs seconds of compilation.

    Args:
        f: vehicles, see `flatgym.kernels.layout`.
        ids: seeds and episode numbers, shape (2, n), uint64.
        hoops: (x, z, direction x, direction z, diameter) of each hoop, shape (n, H, 5).
        pool: start states and hoops passed, shape (m, 6); m = 0 without a pool.
        settings: shape (1,), dtype SETTINGS.
        distribution: parameters of the distribution of scenarios, shape (11,); empty without one.
        pending: queues of delayed controls, shape (n, slots, 2).
        actions: shape (whole blocks, 2).
        given: requested starts, shape (n, 7), see `start_requested`; shape (0, 7) for a step.
        observation, record, counts, flags: results, see `flatgym.envs.fleet.StepResult`.
        ended: receives the indices of the vehicles whose episode ended, shape (n,).
        final_observation, final: results before autoreset; written only with `same_step`.

    Returns:
        The number of episodes that ended; -1, and nothing has changed, if an action is not finite.
    """
    c, count, total, stepping = settings[0], np.uint64(ids.shape[1]), 0, given.shape[0] == 0
    s, t, world = np.zeros(SCRATCH), np.empty(SEEN, dtype=np.float32), (ids, hoops, pool, distribution)
    if stepping and not all_finite(actions):
        return -1
    for first in range(ZERO, count, LANES):
        o, n = first // LANES * SPAN, min(LANES, count - first)
        m = (n + GROUP - ONE) // GROUP * GROUP
        if stepping:
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
                    ended[total] = first + i
                    total += 1
            if c.same_step:
                write_record(f, s, o, n, first, c.dt, final)
                write_observation(f, s, t, o, n, m, c, ids, first, final_observation)
            autoreset(f, s, o, n, END if c.same_step else WAITED, c, world, first)
        write_record(f, s, o, n, first, c.dt, record)
        write_counts_and_flags(f, s, o, n, first, counts, flags)
        write_observation(f, s, t, o, n, m, c, ids, first, observation)
    return total
