"""Measurements of the environments: speed relative to CartPole, import and start-up time, memory growth.

    flatquad measure environments [SECTION]... [--quick] [--out FILE]

The baseline is CartPole-v1, Gymnasium's lightest environment. Both use default settings and random actions, and are
timed in alternation (`experiments.measurements.interleaved`). Torch has one thread; each row states the number of busy
cores. A row with a `target`, set before the measurement, names the `metric` it applies to and whether it is `passed`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common import env_util
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import agents
from agents.training.threads import torch_threads
from experiments.files import Row
from experiments.measurements.interleaved import Candidate, batch, interleaved, ratio, single
from experiments.measurements.libraries.agreement import agreement
from experiments.measurements.libraries.memory import memory
from experiments.measurements.libraries.speed import libraries
from experiments.measurements.sections import Advance, Section, fresh_process, median
from flatgym import SCENARIOS

BASELINE, OURS = "CartPole-v1", "FlatQuad-v0"
ROUNDS, SECONDS = 25, 0.15
"""Timed runs of each candidate, and their length [s]; short runs keep the compared ones close in time."""
SCENARIO, DRAWN = "hoop", ("random-hoops", "random-goal", "random-track")
"""The scenario with the target, and the distributions, which sample a scenario for each episode."""
ENVS, BASELINE_ENVS = 4096, 1024
LADDER = (1, 16, 256, 1024, 16384)
"""Numbers of environments besides ENVS."""
MINIBATCHES = (4096, 64)
"""Minibatch sizes of PPO: that of `agents.PPOConfig`, a quarter of a rollout, and SB3's default. With the default the
2,560 updates after each rollout take nearly all the time, equally for both environments."""


def with_target(row: Row, metric: str, target: float, *, at_most: bool = False) -> Row:
    """Return a row with a target of one of its values, a minimum or a maximum, and whether it is passed."""
    passed = row[metric] <= target if at_most else row[metric] >= target
    return row | {"metric": metric, "target": target, "passed": bool(passed)}


def batched(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second does the batched environment run, by scenario, by number, and without numba?"""
    rounds, seconds, envs, baseline_envs = (2, 0.01, 64, 16) if quick else (ROUNDS, SECONDS, ENVS, BASELINE_ENVS)
    names = [SCENARIO, *DRAWN, *(name for name in SCENARIOS if name != SCENARIO)]
    candidates = [batch(BASELINE, baseline_envs, id=BASELINE)]
    candidates += [batch(name, envs, id=OURS, scenario=name) for name in names]
    candidates += [batch(SCENARIO, n, id=OURS, scenario=SCENARIO) for n in (LADDER[:2] if quick else LADDER)]
    baseline, hoop, *others = interleaved(candidates, rounds, seconds, advance)
    rows = [baseline, with_target(hoop, "ratio", 1.5)]
    for row in others:
        row |= {"ratio_to_hoop": ratio(row, hoop)}
        rows.append(with_target(row, "ratio_to_hoop", 0.7) if row["what"] == DRAWN[0] else row)
    return [*rows, *without_numba(rounds, seconds, envs, baseline_envs)]


def without_numba(rounds: int, seconds: float, envs: int, baseline_envs: int) -> list[Row]:
    """Time the batched environment in NumPy alone, in a new process, together with the baseline."""
    code = f"""
import json, sys
sys.modules["numba"] = None  # importing it fails
import flatgym
from experiments.measurements.interleaved import batch, interleaved
baseline = batch({BASELINE!r}, {baseline_envs}, id={BASELINE!r})
ours = batch({SCENARIO!r}, {envs}, id={OURS!r}, scenario={SCENARIO!r})
print(json.dumps(interleaved([baseline, ours], {rounds}, {seconds})))
"""
    return [row | {"numba": False} for row in json.loads(output(code))]


def scalar(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second does `gym.make` reach, in its default wrappers, resets included?"""
    rounds, seconds = (2, 0.01) if quick else (ROUNDS, SECONDS)
    candidates = [single(BASELINE, id=BASELINE), single(SCENARIO, id=OURS, scenario=SCENARIO)]
    baseline, ours = interleaved(candidates, rounds, seconds, advance)
    return [baseline, with_target(ours, "ratio", 0.6)]


def imports(quick: bool, advance: Advance) -> list[Row]:
    """How long are an import and the first step in a new process, and are compiled kernels stored on disk?"""
    runs, colds = (1, 1) if quick else (9, 3)
    codes = {"python": "pass"} | {f"import {name}": f"import {name}" for name in ("numpy", "gymnasium", "flatgym")}
    times: dict[str, list[float]] = {what: [] for what in codes}
    for i in range(runs):
        for what, code in codes.items():
            times[what].append(fresh_process(code))
        advance(i + 1, runs + colds)
    rows = [{"what": what, **median(seconds)} for what, seconds in times.items()]
    rows[-1] = with_target(rows[-1], "median_s", 0.35, at_most=True)
    return [*rows, *first_steps(runs, colds, lambda done: advance(runs + done, runs + colds))]


def first_steps(warms: int, colds: int, advance: Callable[[int], None]) -> list[Row]:
    """Time make, reset and the first step in new processes, with an empty and with a filled compiler cache."""
    cold: list[tuple[float, int]] = []
    for i in range(colds):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(first_step(cache))
            warm = [first_step(cache) for _ in range(warms)]
        advance(i + 1)
    rows = [
        {"what": f"first step, {name}", **median([seconds for seconds, _ in runs]), "compiled": max(n for _, n in runs)}
        for name, runs in (("cold cache", cold), ("warm cache", warm))
    ]
    warm_row = with_target(rows[1], "compiled", 0, at_most=True)
    # If the cold processes stored nothing either, the cache does not work.
    return [rows[0], warm_row | {"passed": warm_row["passed"] and rows[0]["compiled"] > 0}]


def first_step(cache: str) -> tuple[float, int]:
    """Return the time of make, reset and first step in a new process [s], and the number of functions it compiled."""
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
    """Return the standard output of a new Python process that runs `code`."""
    command, variables = [sys.executable, "-c", code], os.environ | environment
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, env=variables, start_new_session=True
    )  # Ctrl-C is for this process, which ends the other
    return done.stdout


@torch_threads()
def sb3(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second reach Stable-Baselines3, compared with as many CartPoles in its DummyVecEnv?"""
    rounds, seconds, n = (2, 0.01, 16) if quick else (ROUNDS, 2 * SECONDS, BASELINE_ENVS)
    dummy = DummyVecEnv([partial(gym.make, BASELINE)] * n)
    candidates = [
        sb3_candidate(f"DummyVecEnv of {BASELINE}", dummy),
        sb3_candidate(SCENARIO, agents.make_vec_env(SCENARIO, n)),
    ]
    baseline, ours = interleaved(candidates, rounds, seconds, advance)
    return [baseline, with_target(ours, "ratio", 20.0)]


def sb3_candidate(what: str, envs: VecEnv, pool_size: int = 4) -> Candidate:
    """Return a Stable-Baselines3 environment with random actions; it resets automatically."""
    envs.action_space.seed(0)
    pool = [np.stack([envs.action_space.sample() for _ in range(envs.num_envs)]) for _ in range(pool_size)]
    envs.reset()

    def play() -> int:
        for actions in pool:
            envs.step(actions)
        return pool_size * envs.num_envs

    return Candidate(what, envs.num_envs, play)


@torch_threads()
def ppo(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second does PPO train on, end to end? Network, rollout, minibatch and epochs are the same.

    A rollout has 16,384 steps: 256 of our environments for 64 steps, 64 CartPoles for 256 steps.
    """
    rounds, rollout, ours_n, baseline_n = (2, 64, 8, 4) if quick else (4, 16384, 256, 64)
    rows: list[Row] = []
    for i, minibatch in enumerate([32, 16] if quick else MINIBATCHES):
        baseline = ppo_candidate(BASELINE, env_util.make_vec_env(BASELINE, baseline_n), rollout, minibatch)
        ours = ppo_candidate(SCENARIO, agents.make_vec_env(SCENARIO, ours_n), rollout, minibatch)

        def count(done: int, of: int, before: int = i * rounds) -> None:
            advance(before + done, len(MINIBATCHES) * of)

        first, second = interleaved([baseline, ours], rounds, 0.0, count)
        pair = [first, with_target(second, "ratio", 1.5) if i == 0 else second]
        rows += [row | {"rollout": rollout, "minibatch": minibatch} for row in pair]
    return rows


def ppo_candidate(what: str, envs: VecEnv, rollout: int, minibatch: int) -> Candidate:
    """Return SB3's PPO with this rollout and minibatch; a run trains on two rollouts."""
    n_steps = rollout // envs.num_envs
    model = PPO("MlpPolicy", envs, n_steps=n_steps, batch_size=minibatch, seed=0, device="cpu")

    def play() -> int:
        model.learn(2 * rollout, reset_num_timesteps=False)
        return 2 * rollout

    return Candidate(what, envs.num_envs, play)


SECTIONS: dict[str, Section] = {
    "batched": batched,
    "scalar": scalar,
    "imports": imports,
    "sb3": sb3,
    "ppo": ppo,
    "memory": memory,
    "libraries": libraries,
    "agreement": agreement,
}
"""The sections by name."""
