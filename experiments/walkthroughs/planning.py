# %% [markdown]
# # For planning: gradient descent through the flight
#
# The flight is a closed form, and differentiable. So is the place at which a path crosses a hoop's line. A plan is
# therefore found by plain gradient descent on its actions, for many random starts at once, in JAX. It is scored against
# K*, the fewest steps known. Planning needs no network, no value function, and no solver.
#
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.planning`, with `--quick` in seconds.

# %%
"""Walk-through for planning: a loss of the flight, its gradient, descent from many starts, score against K*, draw."""

import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import flatgym
from experiments import figures
from flatgym import task
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import OUTCOMES, EpisodeState, Scene

QUICK = "--quick" in sys.argv
NAME = "hoop"
FOLDER = Path("experiments/results/walkthroughs/planning")
FOLDER.mkdir(parents=True, exist_ok=True)
STARTS, DESCENTS, SLACK = (8, 300, 20) if QUICK else (24, 1500, 8)
scenario, best = flatgym.scenario(NAME), reference(NAME)
assert best is not None

# %% [markdown]
# ## The loss
#
# `Quadrotor.fly` gives the states of a whole plan at once. The loss is what is missing at the goal, in units of the
# tolerance, and at the hoop, in units of the gap. Whether a hoop was passed is a yes or no without a gradient; where
# its line is crossed, `task.passage`, has one.

# %%
quadrotor, tolerance, hoop = scenario.quadrotor, scenario.tolerance, scenario.hoops[0]
start = jnp.asarray(scenario.start_state)
goal = jnp.asarray(scenario.goal_state)
units = jnp.asarray([tolerance.position] * 2 + [tolerance.speed] * 2 + [tolerance.angle])


def missing(plan: Any) -> tuple[Any, ...]:
    """Return what a plan (K, 2), unbounded numbers, lacks at the goal and at the hoop, each at least 0."""
    controls = quadrotor.control(jnp.tanh(plan))
    states = quadrotor.fly(start, controls, scenario.dt)
    scene = Scene.of([scenario] * len(plan)).to(jnp, states.dtype)
    zero = jnp.zeros(len(plan), dtype=int)
    _, aside = task.passage(scene, EpisodeState(states[:-1], zero, zero, zero), controls)
    # Without a crossing the nearest state must come closer.
    nearest = jnp.min(jnp.hypot(states[:, 0] - hoop.x, states[:, 1] - hoop.z))
    crossed = ~jnp.isnan(aside)
    at_hoop = jnp.where(crossed.any(), jnp.min(jnp.where(crossed, jnp.abs(aside), jnp.inf)), nearest)
    at_goal = (states[-1] - goal) / units
    return jnp.linalg.norm(at_goal[:2]), jnp.linalg.norm(at_goal[2:4]), jnp.abs(at_goal[4]), 2 * at_hoop / hoop.diameter


def loss(plan: Any) -> Any:
    """Return the squares of what is missing beyond a little less than the tolerances."""
    return jnp.sum(jnp.maximum(jnp.stack(missing(plan)) - 0.8, 0.0) ** 2)


# %% [markdown]
# ## The descent
#
# Adam, written out, for all starts at once. The actions of a start are random, but for a lean towards the goal.

# %%
gradient = jax.grad(lambda plans: jnp.sum(jax.vmap(loss)(plans)))


@jax.jit
def descend(plans: Any) -> Any:
    """Return the plans after DESCENTS steps of Adam, and their losses."""

    def improve(carry: Any, count: Any) -> Any:
        plans, mean, square = carry
        slope = gradient(plans)
        mean, square = 0.9 * mean + 0.1 * slope, 0.99 * square + 0.01 * slope**2
        rate = 0.05 * (1 - count / DESCENTS) / (1 - 0.9 ** (count + 1))
        return (plans - rate * mean / (jnp.sqrt(square / (1 - 0.99 ** (count + 1))) + 1e-9), mean, square), None

    zeros = jnp.zeros_like(plans)
    (plans, _, _), _ = jax.lax.scan(improve, (plans, zeros, zeros), jnp.arange(DESCENTS))
    return plans, jax.vmap(loss)(plans)


# %% [markdown]
# ## The fewest steps
#
# A flight of fewer and fewer steps, from where the last one was found, until no start reaches the goal. Each plan is
# flown in the exact task, in double precision: that alone counts.

# %%
generator = np.random.default_rng(0)
steps, plan, lean = best.k_star + SLACK, None, np.array([1.0, 0.0])
while steps >= best.k_star:
    starts = lean + generator.normal(0, 1, (STARTS, 1, 2)) + generator.normal(0, 0.5, (STARTS, steps, 2))
    if plan is not None:
        starts[: STARTS // 2] = np.arctanh(0.98 * plan[:steps]) + generator.normal(0, 0.2, (STARTS // 2, steps, 2))
    plans, losses = descend(jnp.asarray(starts))
    flights = [np.tanh(np.asarray(plans[i], dtype=float)) for i in np.argsort(losses)[:3]]
    ends = [fly_actions(scenario, actions)[-1] for actions in flights]
    arrived = [i for i, end in enumerate(ends) if OUTCOMES[end.outcome[0]] == "goal"]
    print(f"{steps} steps: smallest loss {np.min(losses):.2g}, {len(arrived)} of the best 3 plans reach the goal")
    if not arrived:
        break
    plan = flights[arrived[0]][: int(ends[arrived[0]].steps[0])]
    steps = len(plan) - 1
    if QUICK:
        break

# %% [markdown]
# ## The picture and the result

# %%
tracks = [figures.replayed_track(scenario, best.actions, "optimum")]
conclusion = f"No plan of {steps} steps reaches the goal of {NAME!r}; K* = {best.k_star}."
if plan is not None:
    tracks.append(figures.replayed_track(scenario, plan, "gradient descent"))
    conclusion = (
        f"Gradient descent flies {NAME!r} in {len(plan)} steps, {len(plan) / best.k_star - 1:+.1%} to K* = "
        f"{best.k_star}, from {STARTS} random starts and {DESCENTS} steps of descent for each number of steps."
    )
figures.write_page(figures.paths(scenario, tracks, f"{NAME}: the optimum and the plan"), FOLDER / "paths.html")
print(conclusion)
