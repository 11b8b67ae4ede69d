"""Speeds by turns: who is compared plays in the same process, one after the other, round after round.

A machine's speed drifts, so a ratio of two medians taken minutes apart says little. Here every player has the same
time in each round, the order is turned round from round to round, and a ratio is the median of the ratios within the
rounds. Actions are drawn before the clock runs, for all alike.

Numba is not needed here, nor anything that needs it: the environments are also timed where it is missing.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

POOL = 32
"""Batches of actions drawn before the clock runs, then played in a circle."""


@dataclass(frozen=True)
class Candidate:
    """Who is timed.

    Attributes:
        what: environment or scenario.
        num_envs: how many fly at once.
        play: plays some steps, and returns how many these were, all environments counted.
    """

    what: str
    num_envs: int
    play: Callable[[], int]


def batch(what: str, num_envs: int, **arguments: Any) -> Candidate:
    """Return a batched environment as Gymnasium makes it, with random actions; `arguments` as in `gym.make_vec`."""
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
    """Return one environment in Gymnasium's own wrappers, with random actions and a reset after every end."""
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
    """Return steps per second over at least `seconds` and one call, and how many cores this process kept busy."""
    begun, worked, steps, taken = time.perf_counter(), time.process_time(), 0, 0.0
    while not steps or taken < seconds:
        steps += play()
        taken = time.perf_counter() - begun
    return steps / taken, (time.process_time() - worked) / taken


def interleaved(
    players: Sequence[Candidate], rounds: int, seconds: float, advance: Callable[[int, int], None] = lambda *_: None
) -> list[dict[str, Any]]:
    """Time players by turns.

    Args:
        players: the first is the peer of the others.
        rounds: turns of each; one call before them all is not timed, for what is done only once.
        seconds: least time of a turn.
        advance: called after each round with the rounds done and all there are.

    Returns:
        A row for each player: what, num_envs, steps_per_s (the median of `rates`, one a round), cores, and ratio
        to the peer.
    """
    taken: list[list[tuple[float, float]]] = [[] for _ in players]
    for player in players:
        player.play()
    for i in range(rounds):
        for j in list(range(len(players)))[:: 1 if i % 2 == 0 else -1]:
            taken[j].append(rate(players[j].play, seconds))
        advance(i + 1, rounds)
    rows = [row(player, turns) for player, turns in zip(players, taken, strict=True)]
    return [each | {"ratio": ratio(each, rows[0])} for each in rows]


def row(player: Candidate, turns: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return what a player's turns gave, each a rate and the cores it took."""
    rates, cores = zip(*turns, strict=True)
    return {
        "what": player.what,
        "num_envs": player.num_envs,
        "steps_per_s": statistics.median(rates),
        "rates": list(rates),
        "cores": statistics.median(cores),
    }


def ratio(mine: dict[str, Any], its: dict[str, Any]) -> float:
    """Return how many times as fast one row is as another: the median of the ratios within the rounds."""
    return statistics.median(a / b for a, b in zip(mine["rates"], its["rates"], strict=True))
