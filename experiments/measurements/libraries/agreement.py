"""Agreement of PyTorch and JAX with NumPy: the same actions flown on all scenarios, each library by itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from experiments.files import Row
from experiments.measurements.libraries.one_core import PRECISIONS, in_new_process
from experiments.measurements.sections import Advance
from flatgym import DISTRIBUTIONS, OUTCOMES, SCENARIOS, reference, task
from flatgym.task.scene import FLYING, EpisodeState, Scene

SAME, MAX_ERROR = {"float32": 0.999, "float64": 1.0}, 1e-10
"""Least share of episodes with the same outcome after the same steps; largest error of states in double precision."""
COPIES, DRAWN = 40, 240
"""Vehicles of each named scenario, and of each distribution."""
ERROR = 0.02
"""Standard deviation of the errors of actions that follow a best-known flight."""
FLIGHT = 500
"""Steps of the flights; a track's time limit may be longer."""


def agreement(quick: bool, advance: Advance) -> list[Row]:
    """Do PyTorch and JAX fly as NumPy does, on all scenarios? Largest error, and outcomes of the episodes."""
    copies, drawn, steps, precisions = (1, 2, 20, PRECISIONS[1:]) if quick else (COPIES, DRAWN, FLIGHT, PRECISIONS)
    rows: list[Row] = in_new_process(__name__, f"agreements({copies}, {drawn}, {steps}, {precisions})")
    advance(1, 1)
    for row in rows:
        row |= {"same_share": row["same"] / row["episodes"], "metric": "same_share", "target": SAME[row["precision"]]}
        exact = row["precision"] == "float32" or row["max_error"] <= MAX_ERROR
        row["passed"] = bool(row["same_share"] >= row["target"] and exact)
    return rows


def agreements(copies: int, drawn: int, steps: int, precisions: Sequence[str]) -> list[Row]:
    """Fly the same actions in NumPy, PyTorch and JAX; the flights of each library go their own way.

    Of each named scenario one vehicle follows the best-known flight, and nearly half of the others follow it with small
    errors, so that they meet hoops and goals. All others act at random.
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
            errors = 0.0 if problems.index(scenario) == i - 1 else generator.normal(0, ERROR, (count, 2))
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
    """Return the largest difference of states, and how many episodes end with the same outcome after the same steps."""
    ours, theirs = expected[-1], found[-1]
    same = (ours.outcome == theirs.outcome) & (ours.steps == theirs.steps)
    errors = (
        np.abs(one.state - other.state)[same].max(initial=0.0) for one, other in zip(expected, found, strict=True)
    )
    words, counts = np.unique([OUTCOMES[code] for code in ours.outcome], return_counts=True)
    return {
        "env_steps": int(ours.steps.sum()),
        "max_error": float(max(errors)),
        "episodes": len(same),
        "same": int(same.sum()),
        "hoops_passed": int(ours.hoops_passed.sum()),
        "outcomes": dict(zip(words.tolist(), counts.tolist(), strict=True)),
        "differing": [
            {
                "vehicle": int(i),
                "outcomes": [OUTCOMES[one.outcome[i]] for one in (ours, theirs)],
                "steps": [int(one.steps[i]) for one in (ours, theirs)],
                "hoops_passed": [int(one.hoops_passed[i]) for one in (ours, theirs)],
            }
            for i in np.flatnonzero(~same)
        ],
    }
