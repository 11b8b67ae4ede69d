"""Measurements of the task over PyTorch and JAX: speed beside the compiled kernels, and agreement with NumPy.

Both run in a new process on one core: a process that has imported PyTorch or JAX keeps its number of threads.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from experiments.files import Row
from experiments.measurements.interleaved import POOL, Candidate, batch, interleaved
from experiments.measurements.sections import Advance
from flatgym import DISTRIBUTIONS, OUTCOMES, SCENARIOS, reference, task
from flatgym.task.scene import FLYING, EpisodeState, Scene

SCENARIO, ENVS = "hoop", 4096
ROUNDS, SECONDS = 25, 0.15
"""Timed runs of each candidate, and their length [s]."""
PRECISIONS = ("float32", "float64")
SAME, MAX_ERROR = {"float32": 0.999, "float64": 1.0}, 1e-10
"""Least share of episodes with the same outcome after the same steps; largest error of states in double precision."""
TARGET = 1e6
"""Least steps a second of JAX, jitted, in single precision."""
ONE_CORE = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "JAX_PLATFORMS": "cpu",
    "OMP_NUM_THREADS": "1",
}
COPIES, DRAWN = 20, 120
"""Vehicles of each named scenario, and of each distribution."""
FLIGHT = 500
"""Steps of the flights; a track's time limit may be longer."""


def libraries(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second do PyTorch and JAX run beside the compiled kernels, on one core?"""
    rounds, seconds, envs, precisions = (2, 0.01, 64, PRECISIONS[:1]) if quick else (ROUNDS, SECONDS, ENVS, PRECISIONS)
    rows: list[Row] = in_new_process(f"speeds({envs}, {rounds}, {seconds}, {precisions})")
    advance(1, 1)
    for row in rows:
        if row["what"] == f"JAX, float32 of {SCENARIO}":
            passed = bool(row["steps_per_s"] >= TARGET)
            row |= {"metric": "steps_per_s", "target": TARGET, "passed": passed}
    return rows


def agreement(quick: bool, advance: Advance) -> list[Row]:
    """Do PyTorch and JAX fly as NumPy does, on all scenarios? Largest error, and outcomes of the episodes."""
    copies, drawn, steps, precisions = (1, 2, 20, PRECISIONS[1:]) if quick else (COPIES, DRAWN, FLIGHT, PRECISIONS)
    rows: list[Row] = in_new_process(f"agreements({copies}, {drawn}, {steps}, {precisions})")
    advance(1, 1)
    for row in rows:
        row |= {"same_share": row["same"] / row["episodes"], "metric": "same_share", "target": SAME[row["precision"]]}
        exact = row["precision"] == "float32" or row["max_error"] <= MAX_ERROR
        row["passed"] = bool(row["same_share"] >= row["target"] and exact)
    return rows


def in_new_process(call: str) -> Any:
    """Return the value of a call of a function of this module, on one core."""
    code = f"import json\nfrom {__name__} import *\nprint(json.dumps({call}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | ONE_CORE,
        start_new_session=True,  # Ctrl-C is for this process, which ends the other
    )
    return json.loads(done.stdout.splitlines()[-1])


def speeds(envs: int, rounds: int, seconds: float, precisions: Sequence[str]) -> list[Row]:
    """Time the compiled kernels, PyTorch and JAX in alternation."""
    import jax
    import torch

    torch.set_num_threads(1)
    config: Any = jax.config
    config.update("jax_enable_x64", True)
    candidates = [batch(SCENARIO, envs, id="FlatQuad-v0", scenario=SCENARIO)]
    for name in precisions:
        candidates += [torch_batch(envs, name), jax_batch(envs, name)]
    return interleaved(candidates, rounds, seconds)


def torch_batch(envs: int, precision: str) -> Candidate:
    """Return the batch of tensors with random actions."""
    import torch

    from flatgym.envs.torch_vector import FlatQuadTorchVectorEnv

    batch = FlatQuadTorchVectorEnv(envs, SCENARIO, autoreset_mode="SameStep", dtype=getattr(torch, precision))
    pool = [torch.rand(envs, 2) * 2 - 1 for _ in range(POOL)]
    batch.reset(seed=0)

    def play() -> int:
        for actions in pool:
            batch.step(actions)
        return POOL * envs

    return Candidate(f"PyTorch, {precision} of {SCENARIO}", envs, play)


def jax_batch(envs: int, precision: str) -> Candidate:
    """Return the task in one jitted function, step, reward, observation and autoreset, with random actions."""
    import jax
    import jax.numpy as jnp

    from flatgym.envs.spaces import controls_of

    scene = Scene.of([SCENARIOS[SCENARIO]]).repeat(envs).to(jnp, dtype=getattr(jnp, precision))

    @jax.jit
    def step(scene: Scene, before: EpisodeState, actions: Any) -> tuple[Any, ...]:
        after = task.advance(scene, before, controls_of(scene.quadrotor, actions))
        reward = task.reward(scene, before, after, shaped=True)
        following = after.put(after.outcome != FLYING, task.initial(scene))
        return following, task.observe(scene, following), reward, after.terminated, after.truncated

    wait: Any = jax.block_until_ready
    generator = np.random.default_rng(0)
    pool = [jnp.asarray(generator.uniform(-1, 1, (envs, 2)), dtype=scene.start.dtype) for _ in range(POOL)]
    episode = task.initial(scene)
    wait(step(scene, episode, pool[0]))

    def play() -> int:
        nonlocal episode
        for actions in pool:
            episode, *results = step(scene, episode, actions)
        wait(results)
        return POOL * envs

    return Candidate(f"JAX, {precision} of {SCENARIO}", envs, play)


def agreements(copies: int, drawn: int, steps: int, precisions: Sequence[str]) -> list[Row]:
    """Fly the same actions in NumPy, PyTorch and JAX; the flights of each library go their own way.

    Of each named scenario half of the vehicles follow the best-known flight with small errors, so that they meet hoops
    and goals. All others act at random.
    """
    import jax
    import jax.numpy as jnp
    import torch

    config: Any = jax.config
    config.update("jax_enable_x64", True)
    sampled = [distribution.scenario(seed) for distribution in DISTRIBUTIONS.values() for seed in range(drawn)]
    problems = [scenario for scenario in SCENARIOS.values() for _ in range(copies)] + sampled
    scene, generator = Scene.of(problems), np.random.default_rng(0)
    actions = np.repeat(generator.uniform(-1, 1, (-(-steps // 6), len(problems), 2)), 6, axis=0)[:steps]
    for i, scenario in enumerate(problems):
        known = reference(scenario) if i % 2 else None
        if known is not None:
            count = min(steps, len(known.actions))
            errors = generator.normal(0, generator.choice([0.0, 0.02]), (count, 2))
            actions[:count, i] = np.clip(known.actions[:count] + errors, -1, 1)
    controls = scene.quadrotor.control(actions)
    expected = flight(task.advance, scene, task.initial(scene), controls)
    rows = []
    for name, xp, advance in (("PyTorch", torch, task.advance), ("JAX", jnp, jax.jit(task.advance))):
        for precision in precisions:
            there = scene.to(xp, getattr(xp, precision))
            acting = [xp.asarray(control, dtype=getattr(xp, precision)) for control in controls]
            found = flight(advance, there, task.initial(there), acting)
            rows.append({"what": name, "precision": precision} | compared(found, expected))
    return rows


def flight(
    advance: Callable[..., EpisodeState], scene: Scene, episode: EpisodeState, controls: Any
) -> list[EpisodeState]:
    """Return the episodes after each step, in NumPy; an episode that has ended stays as it is."""
    flown = []
    for control in controls:
        episode = advance(scene, episode, control).put(episode.outcome != FLYING, episode)
        flown.append(episode.to(np))
    return flown


def compared(found: list[EpisodeState], expected: list[EpisodeState]) -> Row:
    """Return the largest difference of states, and how many episodes agree in all integers at every step."""
    same = np.ones(len(expected[0].steps), dtype=bool)
    error = 0.0
    for ours, theirs in zip(expected, found, strict=True):
        for name in ("steps", "hoops_passed", "outcome"):
            same &= getattr(ours, name) == getattr(theirs, name)
        error = max(error, float(np.abs(ours.state - theirs.state)[same].max(initial=0.0)))
    words, counts = np.unique([OUTCOMES[code] for code in expected[-1].outcome], return_counts=True)
    return {
        "env_steps": int(expected[-1].steps.sum()),
        "max_error": error,
        "episodes": len(same),
        "same": int(same.sum()),
        "hoops_passed": int(expected[-1].hoops_passed.sum()),
        "outcomes": dict(zip(words.tolist(), counts.tolist(), strict=True)),
        "differing": differing(found[-1], expected[-1], same),
    }


def differing(found: EpisodeState, expected: EpisodeState, same: Any) -> list[Row]:
    """Return the ends of the episodes that differ."""
    return [
        {
            "vehicle": int(i),
            "outcomes": [OUTCOMES[one.outcome[i]] for one in (expected, found)],
            "steps": [int(expected.steps[i]), int(found.steps[i])],
            "hoops_passed": [int(expected.hoops_passed[i]), int(found.hoops_passed[i])],
        }
        for i in np.flatnonzero(~same)
    ]
