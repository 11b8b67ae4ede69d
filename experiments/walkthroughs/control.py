# %% [markdown]
# # For control: a task of your own, its optimum, and the proof
#
# A planar quadrotor is to fly from rest to rest in the least time, through a hoop, with limited thrust and pitch rate.
# A flight alone does not show whether it is the fastest. Here we define such a task, solve it, certify the flight,
# prove a lower bound, compare three independent methods, and export the flight as a CSV file.
#
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.control`, with `--quick` in seconds.

# %%
"""Walk-through for control: define a task, solve, certify, prove, compare methods, export."""

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
# A `Scenario` is a frozen value: lengths in metres, x to the right, z up. An impossible one is refused when it is made;
# the error names the field. We also define the same task without its hoop.

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
# `solve` uses direct multiple shooting with the exact step. It tries several windings (whole turns of the vehicle),
# each from several initial guesses, and returns the fastest certified flight. A flip can save time through such a
# window.

# %%
solution = optimal.solve(window, max_gap=None)  # the bound is proven below
print(solution.headline)
print(f"T = {solution.time:.5f} s, winding {solution.winding}, in {solution.solve_time:.2f} s of solving")

# %% [markdown]
# ## The certificate
#
# The certificate is independent of the solver. It replays the controls by the closed form of the equations of motion,
# and bounds thrust, rate, heights and hoop clearance in continuous time, not at samples. It rejects the same flight
# through a slightly smaller hoop.

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
# A certified flight is an upper bound of T*. A lower bound takes a proof about all flights: they are divided into
# branches, and multipliers exclude each branch. `check` recomputes every exclusion.

# %%
proof = optimal.prove(window, max_gap=1e-2 if QUICK else 5e-4)
print(proof.verdict)
print(f"no flight takes less than {proof.time:.5f} s; ours is {proof.gap:.3%} longer")
print(f"{len(proof.excluded)} branches, {proof.wall_time:.1f} s; recomputed: {proof.check()}")

# %% [markdown]
# ## Three methods
#
# "shooting" is direct. "flat" is the paper's method: it optimises flat outputs between outer paths. "pontryagin" is
# indirect: it solves the conditions of the maximum principle. They share no transcription, and their agreement is
# evidence for all of them. Pontryagin's method has no hoops, therefore all three are compared in open air. The flat
# method lays its corridors around a flight, each around the flight found in the one before.

# %%
runs = [(open_air, method) for method in ("shooting", "flat", "pontryagin")]
runs += [] if QUICK else [(window, "flat")]
solutions = [optimal.solve(scenario, method=method, max_gap=None) for scenario, method in runs] + [solution]
methods = pd.DataFrame([one.row() for one in solutions])[
    ["scenario", "method", "time_s", "winding", "iterations", "solve_time_s", "max_control_violation"]
].sort_values(["scenario", "time_s"], ignore_index=True)
print(methods.to_string(index=False))

# %% [markdown]
# ## The fewest steps
#
# Agents hold their controls for steps of dt and reach the goal within a tolerance. Their optimum is another number, K*,
# the fewest steps. Its actions replay in the agents' environment.

# %%
best = optimal.fewest_steps(window)
env = gym.make("FlatQuad-v0", scenario=window)
_, info = env.reset(seed=0)
for action in best.actions:
    info = env.step(action)[4]
env.close()
print(f"K* = {best.steps} steps of {window.dt} s; fewer than {best.lower_bound} are impossible")
print(f"in the environment: {info['outcome']!r} after {info['steps']} steps")

# %% [markdown]
# ## The flight as a file
#
# Columns name their quantity and unit. Numbers are written with all digits and read back exactly.

# %%
samples = solution.trajectory.sample(0.01)
file = optimal.save(samples, FOLDER / "window.csv")
print(file.read_text(encoding="utf-8").splitlines()[0])
print(f"{file}: {len(samples.time)} rows, read back exactly: {np.array_equal(optimal.load(file).state, samples.state)}")

# %% [markdown]
# ## The picture
#
# The quadrotor in equal time steps, with its thrust as a flame. Open the pages in a browser.

# %%
through = figures.optimal_track(solution)
around = figures.optimal_track(next(one for one in solutions if one.scenario == open_air and one.method == "shooting"))
tracks = [through, figures.replayed_track(window, best.actions, "K*"), around]
figures.write_page(
    figures.paths([window, window, open_air], tracks, "The window, and the open air"), FOLDER / "paths.html"
)
figures.write_page(figures.controls(window.quadrotor, tracks, "Thrust and rate"), FOLDER / "controls.html")
print(f"pictures: {FOLDER / 'paths.html'}, {FOLDER / 'controls.html'}")

# %% [markdown]
# ## Result

# %%
agreement = methods[methods["scenario"] == open_air.name]["time_s"]
conclusion = (
    f"The hoop costs {solution.time / agreement.min() - 1:.1%}: {solution.time:.4f} s, certified, and no flight "
    f"takes less than {proof.time:.4f} s. In open air three methods that share nothing differ by "
    f"{agreement.max() / agreement.min() - 1:.2%}."
)
print(conclusion)
