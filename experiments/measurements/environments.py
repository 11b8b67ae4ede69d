"""The environments' benchmark: how fast beside CartPole, how soon ready, and how steady in memory?

    python -m experiments.measurements.environments [--out FILE] [--quick] [--section NAME ...]

The peer is CartPole-v1, the lightest environment Gymnasium has; both are made with default settings and flown by
random actions, by turns (`experiments.measurements.interleaved`). Torch has one thread, and how many cores were busy stands in each row.
Where a bar was set beforehand, the row holds the bar, the value it is `bar_on`, and whether it is `met`.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common import env_util
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import agents
from experiments.files import Row
from experiments.measurements import sections
from experiments.measurements.interleaved import Candidate, batch, interleaved, ratio, single
from experiments.measurements.sections import Advance, Section, fresh_process, median
from flatgym import SCENARIOS

PEER, OURS = "CartPole-v1", "FlatQuad-v0"
ROUNDS, SECONDS = 25, 0.15
"""Turns of each player, and the time of a turn [s]: many short ones, so that those compared are close in time."""
SCENARIO, DRAWN = "hoop", ("random-hoops", "random-goal")
"""The scenario with the bar, and those drawn anew for each flight."""
ENVS, PEER_ENVS = 4096, 1024
LADDER = (1, 16, 256, 1024, 16384)
"""Numbers of environments besides ENVS."""
MINIBATCHES = (4096, 64)
"""Of PPO: agents.PPOConfig's, a quarter of a rollout; and SB3's default, with which the 2,560 updates after each
rollout take nearly all the time, the same for both, so that any two environments come out alike."""
MEMORY_STEPS, WARM = 100_000_000, 1_000_000
FLAT = 1.0
"""Growth of the resident memory that counts as none [MB]; the allocator keeps a few pages for itself."""


def judged(row: Row, key: str, bar: float, *, most: bool = False) -> Row:
    """Return a row with its bar: what stands under `key` must be at least that, or at most."""
    return row | {"bar_on": key, "bar": bar, "met": bool(row[key] <= bar if most else row[key] >= bar)}


def batched(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second does the batched environment fly, by scenario and by number, and without numba?"""
    rounds, seconds, envs, peer_envs = (2, 0.01, 64, 16) if quick else (ROUNDS, SECONDS, ENVS, PEER_ENVS)
    names = [SCENARIO, *DRAWN, *(name for name in SCENARIOS if name != SCENARIO)]
    players = [batch(PEER, peer_envs, id=PEER)]
    players += [batch(name, envs, id=OURS, scenario=name) for name in names]
    players += [batch(SCENARIO, n, id=OURS, scenario=SCENARIO) for n in (LADDER[:2] if quick else LADDER)]
    peer, hoop, *others = interleaved(players, rounds, seconds, advance)
    rows = [peer, judged(hoop, "ratio", 1.5)]
    for row in others:
        told = row | {"ratio_to_hoop": ratio(row, hoop)}
        rows.append(judged(told, "ratio_to_hoop", 0.7) if row["what"] == DRAWN[0] else told)
    return [*rows, *without_numba(rounds, seconds, envs, peer_envs)]


def without_numba(rounds: int, seconds: float, envs: int, peer_envs: int) -> list[Row]:
    """Time the batched environment in NumPy alone: in a process of its own, so with the peer once more."""
    code = f"""
import json, sys
sys.modules["numba"] = None  # so that importing it fails
import flatgym
from experiments.measurements.interleaved import batch, interleaved
peer = batch({PEER!r}, {peer_envs}, id={PEER!r})
ours = batch({SCENARIO!r}, {envs}, id={OURS!r}, scenario={SCENARIO!r})
print(json.dumps(interleaved([peer, ours], {rounds}, {seconds})))
"""
    return [row | {"numba": False} for row in json.loads(output(code))]


def scalar(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second does `gym.make` give, in its default wrappers, resets included?"""
    rounds, seconds = (2, 0.01) if quick else (ROUNDS, SECONDS)
    players = [single(PEER, id=PEER), single(SCENARIO, id=OURS, scenario=SCENARIO)]
    peer, ours = interleaved(players, rounds, seconds, advance)
    return [peer, judged(ours, "ratio", 0.6)]


def imports(quick: bool, advance: Advance) -> list[Row]:
    """How long do an import and the first step take in a new process, and is what was compiled kept on disk?"""
    runs, colds = (1, 1) if quick else (9, 3)
    codes = {"python": "pass"} | {f"import {name}": f"import {name}" for name in ("numpy", "gymnasium", "flatgym")}
    taken: dict[str, list[float]] = {what: [] for what in codes}
    for i in range(runs):
        for what, code in codes.items():
            taken[what].append(fresh_process(code))
        advance(i + 1, runs + colds)
    rows = [{"what": what, **median(seconds)} for what, seconds in taken.items()]
    rows[-1] = judged(rows[-1], "median_s", 0.35, most=True)
    return [*rows, *first_steps(runs, colds, lambda done: advance(runs + done, runs + colds))]


def first_steps(warms: int, colds: int, tell: Callable[[int], None]) -> list[Row]:
    """Time make, reset and the first step in new processes, the compiler's cache empty and then filled."""
    cold: list[tuple[float, int]] = []
    for i in range(colds):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(first_step(cache))
            warm = [first_step(cache) for _ in range(warms)]
        tell(i + 1)
    rows = [
        {"what": f"first step, {name}", **median([seconds for seconds, _ in runs]), "compiled": max(n for _, n in runs)}
        for name, runs in (("cold cache", cold), ("warm cache", warm))
    ]
    kept = judged(rows[1], "compiled", 0, most=True)
    return [rows[0], kept | {"met": kept["met"] and rows[0]["compiled"] > 0}]  # nothing compiled is nothing kept


def first_step(cache: str) -> tuple[float, int]:
    """Return the seconds of make, reset and the first step in a new process, and the functions it compiled to disk."""
    code = f"""
import time
import gymnasium as gym
import flatgym
begun = time.perf_counter()
envs = gym.make_vec({OURS!r}, num_envs={ENVS}, vectorization_mode="vector_entry_point", scenario={SCENARIO!r})
envs.reset(seed=0)
envs.step(envs.action_space.sample())
print(time.perf_counter() - begun)
"""
    before = set(Path(cache).rglob("*.nbc"))
    seconds = float(output(code, NUMBA_CACHE_DIR=cache))
    return seconds, len(set(Path(cache).rglob("*.nbc")) - before)


def output(code: str, **environment: str) -> str:
    """Return what a new Python process that runs `code` prints."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | environment).stdout


def sb3(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second reach Stable-Baselines3, beside as many CartPoles in its DummyVecEnv?"""
    rounds, seconds, n = (2, 0.01, 16) if quick else (ROUNDS, 2 * SECONDS, PEER_ENVS)
    torch.set_num_threads(1)
    dummy = DummyVecEnv([partial(gym.make, PEER)] * n)
    players = [adapted(f"DummyVecEnv of {PEER}", dummy), adapted(SCENARIO, agents.make_vec_env(SCENARIO, n))]
    peer, ours = interleaved(players, rounds, seconds, advance)
    return [peer, judged(ours, "ratio", 20.0)]


def adapted(what: str, envs: VecEnv, pool_size: int = 4) -> Candidate:
    """Return a Stable-Baselines3 environment with random actions; it resets itself."""
    envs.action_space.seed(0)
    pool = [np.stack([envs.action_space.sample() for _ in range(envs.num_envs)]) for _ in range(pool_size)]
    envs.reset()

    def play() -> int:
        for actions in pool:
            envs.step(actions)
        return pool_size * envs.num_envs

    return Candidate(what, envs.num_envs, play)


def ppo(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second does PPO learn from, end to end? Same network, rollout, minibatch and epochs for both.

    Ours flies 256 at once for 64 steps, CartPole 64 for 256: 16,384 steps a rollout for either.
    """
    rounds, rollout, ours_n, peer_n = (2, 64, 8, 4) if quick else (4, 16384, 256, 64)
    torch.set_num_threads(1)
    rows: list[Row] = []
    for i, minibatch in enumerate([32, 16] if quick else MINIBATCHES):
        peer = learner(PEER, env_util.make_vec_env(PEER, peer_n), rollout, minibatch)
        ours = learner(SCENARIO, agents.make_vec_env(SCENARIO, ours_n), rollout, minibatch)

        def tell(done: int, of: int, before: int = i * rounds) -> None:
            advance(before + done, len(MINIBATCHES) * of)

        first, second = interleaved([peer, ours], rounds, 0.0, tell)
        told = [first, judged(second, "ratio", 1.5) if i == 0 else second]
        rows += [row | {"rollout": rollout, "minibatch": minibatch} for row in told]
    return rows


def learner(what: str, envs: VecEnv, rollout: int, minibatch: int) -> Candidate:
    """Return a PPO with SB3's defaults but for rollout and minibatch, which learns from two rollouts a turn."""
    n_steps = rollout // envs.num_envs
    model = PPO("MlpPolicy", envs, n_steps=n_steps, batch_size=minibatch, seed=0, device="cpu")

    def play() -> int:
        model.learn(2 * rollout, reset_num_timesteps=False)
        return 2 * rollout

    return Candidate(what, envs.num_envs, play)


def memory(quick: bool, advance: Advance) -> list[Row]:
    """Does the resident memory grow over 10^8 steps? Largest growth since the first 10^6, the warming up.

    Each case has a new process: in an old one a leak would hide in what earlier work has given back.
    """
    steps, warm, envs = (20_000, 4_000, 64) if quick else (MEMORY_STEPS, WARM, ENVS)
    marks = [warm, *(steps * share // 10 for share in range(1, 11))]
    cases = [(SCENARIO, "NextStep"), (DRAWN[0], "SameStep")]
    rows: list[Row] = []
    for i, (scenario, mode) in enumerate(cases):
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            checkpoints = pool.submit(steady, scenario, envs, mode, marks).result()
        sizes = [checkpoint["resident_mb"] for checkpoint in checkpoints[1:]]
        row: Row = {"what": scenario, "num_envs": envs, "autoreset": mode, "checkpoints": checkpoints}
        rows.append(judged(row | {"growth_mb": max(sizes) - sizes[0]}, "growth_mb", FLAT, most=True))
        advance(i + 1, len(cases))
    return rows


def steady(scenario: str, envs: int, mode: str, marks: Sequence[int]) -> list[Row]:
    """Fly a scenario and return the resident memory at the marks."""
    return measured(batch(scenario, envs, id=OURS, scenario=scenario, autoreset_mode=mode), marks)


def measured(player: Candidate, marks: Iterable[int]) -> list[Row]:
    """Play on and return the resident memory before the first step and after each mark's number of steps."""
    checkpoints, done = [{"env_steps": 0, "resident_mb": resident()}], 0
    for mark in marks:
        while done < mark:
            done += player.play()
        checkpoints.append({"env_steps": done, "resident_mb": resident()})
    return checkpoints


def resident() -> float:
    """Return this process's resident memory [MB]; where there is no /proc, the most it ever was."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except FileNotFoundError:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak / (1e6 if sys.platform == "darwin" else 1e3)  # bytes on macOS, kilobytes elsewhere
    return pages * resource.getpagesize() / 1e6


SECTIONS: dict[str, Section] = {
    "batched": batched,
    "scalar": scalar,
    "imports": imports,
    "sb3": sb3,
    "ppo": ppo,
    "memory": memory,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the script; see the module's docstring."""
    sections.main(
        "experiments.measurements.environments", __doc__, SECTIONS, Path("experiments/results/envs.json"), arguments
    )


if __name__ == "__main__":
    main()
