# %% [markdown]
# # For control: a task of your own, its optimum, and the proof
#
# A planar quadrotor is to fly from rest to rest in the least time, through a hoop. Its thrust and its pitch rate are
# limited, its path is curved, and nobody can see from a flight alone whether it is the fastest. Here we define such a
# task, solve it, have the answer certified and a lower bound proven, ask three independent methods, and take the
# flight away as a CSV file.
#
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.control`, with `--quick` in seconds.

# %%
"""The control engineer's walk-through: define a task, solve, certify, prove, compare the roads, export."""

import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pandas as pd

import optimal
from experiments import figures
from flatgym import Hoop, Scenario

QUICK = "--quick" in sys.argv
FOLDER = Path("experiments/results/walkthroughs/control")
FOLDER.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## The task
#
# A `Scenario` is a frozen value: lengths in metres, x to the right, z up. Whatever is impossible in it is refused when
# it is made, with words that say which field. Beside the task itself we keep the same one without its hoop.

# %%
window = Scenario("window", start=(0, 0), goal=(4, 1), hoops=(Hoop(2, 1.5, diameter=0.6),))
open_air = replace(window, name="open-air", hoops=())
print(f"{window.name}: from {window.start} to {window.goal} m, thrust up to {window.quadrotor.thrust_max} m/s²")
try:
    Scenario("buried", start=(0, 0), goal=(4, 1), floor=2.0)
except ValueError as refusal:
    print(f"refused: {refusal}")

# %% [markdown]
# ## The flight
#
# `solve` tries whole turns of the vehicle and several starts for each, by direct multiple shooting with the exact
# step, and returns the fastest flight that is certified. To pass a window like this one it can pay to flip over.

# %%
solution = optimal.solve(window, max_gap=None)  # the bound is proven below
print(solution.status)
print(f"T* = {solution.time:.5f} s, {solution.winding} whole turns, in {solution.solve_time:.2f} s of solving")

# %% [markdown]
# ## The certificate
#
# The certificate knows nothing of the solver. It flies the controls again by the closed form of the equations of
# motion, and bounds thrust, rate, heights and the way through the hoop at every instant, not at samples. It can also
# say no: through a slightly smaller hoop the same flight does not pass.

# %%
assert solution.trajectory is not None
for field, value in solution.certificate.row().items():
    print(f"{field:>22}: {value:.3g}")
smaller = replace(window, hoops=(replace(window.hoops[0], diameter=0.59),))
passes, misses = (optimal.certify(solution.trajectory, scenario) for scenario in (window, smaller))
print(f"certified through the hoop: {passes.holds()}; through a smaller one: {misses.holds()}")

# %% [markdown]
# ## The proof
#
# A certified flight shows that T* is not more. That it is not less takes a proof about all flights: they are divided
# into branches, and each branch is excluded by multipliers of its own. `check` computes every exclusion anew.

# %%
proof = optimal.prove(window, max_gap=1e-2 if QUICK else 5e-4)
print(proof.verdict)
print(f"no flight takes less than {proof.time:.5f} s; ours is {proof.gap:.3%} longer")
print(f"{len(proof.excluded)} branches, {proof.wall_time:.1f} s; checked again: {proof.check()}")

# %% [markdown]
# ## Three roads
#
# Shooting is direct; "flat" is the method of the paper, which optimises flat outputs between outer paths; "pontryagin"
# is indirect and solves the conditions of the maximum principle. They share no transcription, so where they agree they
# vouch for each other. Pontryagin knows no hoops: all three meet in open air. The flat road is confined to its
# corridor, which costs it a little, and through the hoop more.

# %%
asked = [(open_air, road) for road in ("shooting", "flat", "pontryagin")]
asked += [] if QUICK else [(window, "flat")]
solutions = [optimal.solve(scenario, method=road, max_gap=None) for scenario, road in asked] + [solution]
roads = pd.DataFrame([one.row() for one in solutions])[
    ["scenario", "method", "time_s", "winding", "iterations", "solve_time_s", "max_control_violation"]
].sort_values(["scenario", "time_s"], ignore_index=True)
print(roads.to_string(index=False))

# %% [markdown]
# ## The fewest steps
#
# Agents fly in steps of dt with held controls, and arrive within a tolerance. Their optimum is another number: K*. Its
# actions replay in the environment, which is the one that agents fly in.

# %%
best = optimal.fewest_steps(window)
env = gym.make("FlatQuad-v0", scenario=window)
_, info = env.reset(seed=0)
for action in best.actions:
    info = env.step(action)[4]
env.close()
print(f"K* = {best.steps} steps of {window.dt} s; fewer than {best.lower_bound} are impossible")
print(f"the environment says: {info['outcome']!r} after {info['steps']} steps")

# %% [markdown]
# ## The flight as a file
#
# Columns name their quantity and unit; numbers are written in full, so that reading gives back the very same ones.

# %%
samples = solution.trajectory.sample(0.01)
file = optimal.save(samples, FOLDER / "window.csv")
print(file.read_text(encoding="utf-8").splitlines()[0])
print(f"{file}: {len(samples.time)} rows, read back alike: {np.array_equal(optimal.load(file).state, samples.state)}")

# %% [markdown]
# ## The picture
#
# The quadrotor stands on its path in equal time steps, its thrust as a flame. Open the pages in a browser.

# %%
through = figures.optimal_track(solution)
around = figures.optimal_track(next(one for one in solutions if one.scenario == open_air and one.method == "shooting"))
tracks = [through, figures.flown_track(window, best.actions, "K*"), around]
figures.write(figures.paths([window, window, open_air], tracks, "The window, and the open air"), FOLDER / "paths.html")
figures.write(figures.controls(window.quadrotor, tracks, "Thrust and rate"), FOLDER / "controls.html")
print(f"pictures: {FOLDER / 'paths.html'}, {FOLDER / 'controls.html'}")

# %% [markdown]
# ## What was learnt

# %%
agreement = roads[roads["scenario"] == open_air.name]["time_s"]
learnt = (
    f"The hoop costs {solution.time / agreement.min() - 1:.1%}: {solution.time:.4f} s, certified, and no flight at all "
    f"takes less than {proof.time:.4f} s. In open air three methods that share nothing differ by "
    f"{agreement.max() / agreement.min() - 1:.2%}."
)
print(learnt)
