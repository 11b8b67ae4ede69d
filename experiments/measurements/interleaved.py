"""Interleaved timing: all candidates run in one process, alternating for several rounds.

A machine's speed drifts, and a ratio of two medians measured minutes apart is unreliable. Here each candidate has the
same time in each round, the order is reversed from round to round, and a ratio is the median of the ratios within the
rounds. Actions are sampled before the clock starts.

This module needs no numba, because the environments are also timed without it.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

POOL = 32
"""Batches of actions that are sampled before the clock starts, then repeated."""


@dataclass(frozen=True)
class Candidate:
    """A candidate of a timing comparison.

    Attributes:
        what: environment or scenario.
        num_envs: number of parallel environments.
        play: runs some steps and returns their number, summed over all environments.
    """

    what: str
    num_envs: int
    play: Callable[[], int]


def batch(what: str, num_envs: int, **arguments: Any) -> Candidate:
    """Return a batched environment with random actions; `arguments` are those of `gym.make_vec`."""
    envs = gym.make_vec(num_envs=num_envs, vectorization_mode="vector_entry_point", **arguments)
    envs.action_space.seed(0)
    pool = [envs.action_space.sample() for _ in range(POOL)]
    envs.reset(seed=0)

    def play() -> int:
        for actions in pool:
            envs.step(actions)
        return POOL * num_envs

    return Candidate(what, num_envs, play)


def single(what: str, **arguments: Any) -> Candidate:
    """Return one environment in Gymnasium's default wrappers, with random actions and a reset after each episode."""
    env: gym.Env[Any, Any] = gym.make(**arguments)
    env.action_space.seed(0)
    pool = [env.action_space.sample() for _ in range(POOL**2)]
    env.reset(seed=0)

    def play() -> int:
        for action in pool:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return len(pool)

    return Candidate(what, 1, play)


def rate(play: Callable[[], int], seconds: float) -> tuple[float, float]:
    """Return steps per second over at least `seconds` and one call, and the mean number of busy cores."""
    begun, worked, steps, taken = time.perf_counter(), time.process_time(), 0, 0.0
    while not steps or taken < seconds:
        steps += play()
        taken = time.perf_counter() - begun
    return steps / taken, (time.process_time() - worked) / taken


def interleaved(
    candidates: Sequence[Candidate], rounds: int, seconds: float, advance: Callable[[int, int], None] = lambda *_: None
) -> list[dict[str, Any]]:
    """Time candidates in alternating order.

    Args:
        candidates: the first is the baseline of the others.
        rounds: number of timed runs of each; one run before the first round is not timed.
        seconds: least time of a run [s].
        advance: called after each round with the number of finished rounds, and of all.

    Returns:
        A row for each candidate: what, num_envs, steps_per_s (the median of `rates`, one a round), cores, and ratio
        to the baseline.
    """
    timed: list[list[tuple[float, float]]] = [[] for _ in candidates]
    for candidate in candidates:
        candidate.play()
    for i in range(rounds):
        for j in list(range(len(candidates)))[:: 1 if i % 2 == 0 else -1]:
            timed[j].append(rate(candidates[j].play, seconds))
        advance(i + 1, rounds)
    rows = [row(candidate, runs) for candidate, runs in zip(candidates, timed, strict=True)]
    return [each | {"ratio": ratio(each, rows[0])} for each in rows]


def row(candidate: Candidate, runs: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return the row of a candidate from its runs, each a rate and a number of busy cores."""
    rates, cores = zip(*runs, strict=True)
    return {
        "what": candidate.what,
        "num_envs": candidate.num_envs,
        "steps_per_s": statistics.median(rates),
        "rates": list(rates),
        "cores": statistics.median(cores),
    }


def ratio(ours: dict[str, Any], baseline: dict[str, Any]) -> float:
    """Return the speed of one row relative to another: the median of the ratios within the rounds."""
    return statistics.median(a / b for a, b in zip(ours["rates"], baseline["rates"], strict=True))
