"""Speed of the task over PyTorch and JAX, on one core, timed in alternation with the compiled kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.files import Row
from experiments.measurements.interleaved import POOL, Candidate, batch, interleaved
from experiments.measurements.libraries.one_core import PRECISIONS, in_new_process
from experiments.measurements.sections import Advance
from flatgym import SCENARIOS, task
from flatgym.task.scene import FLYING, EpisodeState, Scene

SCENARIO, ENVS = "hoop", 4096
ROUNDS, SECONDS = 25, 0.15
"""Timed runs of each candidate, and their length [s]."""
TARGET = 1e6
"""Least steps a second of JAX, jitted, in single precision."""


def libraries(quick: bool, advance: Advance) -> list[Row]:
    """How many steps a second do PyTorch and JAX run beside the compiled kernels, on one core?"""
    rounds, seconds, envs, precisions = (2, 0.01, 64, PRECISIONS[:1]) if quick else (ROUNDS, SECONDS, ENVS, PRECISIONS)
    rows: list[Row] = in_new_process(__name__, f"speeds({envs}, {rounds}, {seconds}, {precisions})")
    advance(1, 1)
    for row in rows:
        if row["what"] == f"JAX, float32 of {SCENARIO}":
            passed = bool(row["steps_per_s"] >= TARGET)
            row |= {"metric": "steps_per_s", "target": TARGET, "passed": passed}
    return rows


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
