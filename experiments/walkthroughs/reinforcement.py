# %% [markdown]
# # For reinforcement learning: train PPO, and know how good it is
#
# Most benchmarks tell whether an agent beats another one. This one tells how far it is from the best there is: K*, the
# fewest environment steps in which the task can be flown. Here we make the environment, wrap it, train PPO twice - as
# Stable-Baselines3 stands, and with the curriculum of this package - and lay what they fly beside the optimum.
#
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.reinforcement`, with `--quick` in seconds.

# %%
"""The RL user's walk-through: make, wrap, train PPO in two ways, score against K*, draw beside the optimum."""

import sys
from pathlib import Path

import gymnasium as gym
import pandas as pd
import torch
from gymnasium.wrappers import RecordEpisodeStatistics
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

import agents
import flatgym
from experiments import figures
from flatgym.scenarios.reference import reference

QUICK = "--quick" in sys.argv
NAME = "horizontal-3"
FOLDER = Path("experiments/results/walkthroughs/reinforcement")
FOLDER.mkdir(parents=True, exist_ok=True)
ENV_STEPS = 2_048 if QUICK else 1_000_000
VEHICLES, ROLLOUT, BATCH = (16, 16, 128) if QUICK else (256, 64, 4096)
torch.set_num_threads(1)  # small networks: a second thread costs more than it gives

# %% [markdown]
# ## The environment
#
# It is a Gymnasium environment like any other, and takes Gymnasium's wrappers. Actions are thrust and pitch rate,
# scaled to [-1, 1]; each observed feature has a name. `info["outcome"]` says in one word how a flight ended.

# %%
env = RecordEpisodeStatistics(gym.make("FlatQuad-v0", scenario=NAME))
print(f"actions {env.action_space}")
print(f"observed: {', '.join(flatgym.observation_names())}")
env.action_space.seed(0)
for episode in range(3):
    _, info = env.reset(seed=episode)
    while info["outcome"] == "flying":
        info = env.step(env.action_space.sample())[4]
    print(f"at random: {info['outcome']} after {info['steps']} steps, return {info['episode']['r']:.2f}")
env.close()

# %% [markdown]
# ## The yardstick
#
# K* of every named scenario is shipped, with a flight in K* steps and whether it is proven that none takes fewer.

# %%
scenario, best = flatgym.scenario(NAME), reference(NAME)
assert best is not None
print(f"K* = {best.k_star} steps of {scenario.dt} s, proven: {best.proven}; T* = {best.time:.4f} s")

# %% [markdown]
# ## PPO as Stable-Baselines3 has it
#
# `make_vec_env` gives Stable-Baselines3 many vehicles in one batch, and Stable-Baselines3's own wrappers fit around it.
# We normalise rewards only: observations are scaled already, and a policy that sees them as they are can be scored as
# it is.

# %%
vec_env = VecNormalize(agents.make_vec_env(NAME, VEHICLES, seed=0), norm_obs=False, gamma=0.995)
plain = PPO(
    "MlpPolicy", vec_env, n_steps=ROLLOUT, batch_size=BATCH, learning_rate=1e-3, gamma=0.995, seed=0, device="cpu"
)
plain.learn(ENV_STEPS)
agents.policies.save(plain, FOLDER / "plain.zip", NAME)
vec_env.close()
print(f"{plain.num_timesteps:,} environment steps")

# %% [markdown]
# ## PPO with a curriculum
#
# `train` is the same PPO of Stable-Baselines3. What it adds is a curriculum: flights that begin close to the goal, a
# tolerance that tightens to the true one, and the best deterministic policy kept. Everything it depends on is one flat
# configuration, and the same configuration gives the same policy, bit for bit.

# %%
config = agents.PPOConfig(
    scenario=NAME,
    env_steps=ENV_STEPS,
    num_envs=VEHICLES,
    n_steps=ROLLOUT,
    batch_size=BATCH,
    folder=str(FOLDER / "ppo"),
)
training = agents.train(config, optimum=best.k_star)
taught = agents.policies.load(training.model, trust=True)  # a zip can hold code: trust only your own
print(pd.DataFrame(training.curve)[["env_steps", "outcome", "steps"]].to_string())

# %% [markdown]
# ## The score
#
# The success rate, and the gap K / K* - 1 of the flights that succeed. A flight in fewer than K* steps would not be a
# record but an error of ours: `evaluate` raises `FasterThanOptimal`. A pretrained policy stands beside, and shows how
# far a network of this size can come.

# %%
policies = {"PPO": plain, "PPO, curriculum": taught, "pretrained": agents.policies.pretrained(NAME)}
scores = pd.concat(
    [agents.evaluate(policy, NAME, episodes=1, agent=name) for name, policy in policies.items()], ignore_index=True
)
print(scores[["agent", "success_rate", "steps", "k_star", "gap", "outcomes"]].to_string(index=False))

# %% [markdown]
# ## The picture
#
# The optimum and the agents, the quadrotor in equal time steps; and what was learnt, against K*.

# %%
tracks = [figures.flown_track(scenario, best.actions, "optimum")]
flights = {name: agents.fly(policy, NAME).actions[0] for name, policy in policies.items()}
tracks += [figures.flown_track(scenario, actions, name) for name, actions in flights.items()]
figures.write(figures.paths(scenario, tracks, f"{NAME}: the optimum and the agents"), FOLDER / "paths.html")
figures.write(figures.learning(training.curve, best.k_star, f"{NAME}: PPO with a curriculum"), FOLDER / "learning.html")
print(f"pictures: {FOLDER / 'paths.html'}, {FOLDER / 'learning.html'}")

# %% [markdown]
# ## What was learnt

# %%
said = {
    row["agent"]: f"in {row['steps']:.0f} steps, {row['gap']:+.1%} to K*" if row["success_rate"] else "astray"
    for _, row in scores.iterrows()
}
learnt = (
    f"After {ENV_STEPS:,} environment steps on {NAME!r} PPO as it stands flies {said['PPO']}, with the curriculum "
    f"{said['PPO, curriculum']}; the pretrained policy flies {said['pretrained']}. Fewer than {best.k_star} steps are "
    "impossible, so whatever gap is left is the agent's."
)
print(learnt)
