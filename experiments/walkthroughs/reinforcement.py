# %% [markdown]
# # For reinforcement learning: train PPO, and know how good it is
#
# Most benchmarks compare agents with each other. This one compares them with the optimum K*, the fewest environment
# steps in which the task can be flown. Here we make the environment, wrap it, train PPO twice (plain Stable-Baselines3,
# and with the curriculum of this package), and compare the flights with the optimum.
#
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.reinforcement`, with `--quick` in seconds.

# %%
"""Walk-through for reinforcement learning: make, wrap, train PPO in two ways, score against K*, draw."""

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
torch.set_num_threads(1)  # small networks: a second thread slows them down

# %% [markdown]
# ## The environment
#
# It is a Gymnasium environment and takes Gymnasium's wrappers. Actions are thrust and pitch rate, scaled to [-1, 1].
# Each observed feature has a name. `info["outcome"]` states in one word how an episode ended.

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
# ## The optimum
#
# The package holds K* of every named scenario, a flight in K* steps, and whether K* is proven.

# %%
scenario, best = flatgym.scenario(NAME), reference(NAME)
assert best is not None
print(f"K* = {best.k_star} steps of {scenario.dt} s, proven: {best.proven}; T* = {best.time:.4f} s")

# %% [markdown]
# ## Plain PPO
#
# `make_vec_env` gives Stable-Baselines3 many vehicles in one batch, and accepts Stable-Baselines3's wrappers. We
# normalise rewards only. Observations are scaled already, and a policy without observation wrapper can be scored
# directly.

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
# `train` uses the same PPO and adds a curriculum: episodes that start near the goal, and a tolerance that tightens to
# the true one. It stores the best deterministic policy. One flat configuration holds all settings; the same
# configuration gives the same policy, bit for bit.

# %%
config = agents.PPOConfig(
    scenario=NAME,
    env_steps=ENV_STEPS,
    num_envs=VEHICLES,
    n_steps=ROLLOUT,
    batch_size=BATCH,
    folder=str(FOLDER / "ppo"),
)
training = agents.train(config, optimum=best.k_star, overwrite=True)
curriculum_policy = agents.policies.load(training.model, trust=True)  # a zip can hold code: trust only your own
print(pd.DataFrame(training.curve)[["env_steps", "outcome", "steps"]].to_string())

# %% [markdown]
# ## The score
#
# A score is the success rate, and the gap K / K* - 1 of the successful episodes. An episode in fewer than K* steps
# would disprove our optimum: `evaluate` raises `FasterThanOptimal`. A pretrained policy shows what a network of this
# size can reach.

# %%
policies = {"PPO": plain, "PPO, curriculum": curriculum_policy, "pretrained": agents.policies.pretrained(NAME)}
scores = pd.concat(
    [agents.evaluate(policy, NAME, episodes=1, agent=name) for name, policy in policies.items()], ignore_index=True
)
print(scores[["agent", "success_rate", "steps", "k_star", "gap", "outcomes"]].to_string(index=False))

# %% [markdown]
# ## The picture
#
# The optimum and the agents in equal time steps, and the learning curve against K*.

# %%
tracks = [figures.replayed_track(scenario, best.actions, "optimum")]
flights = {name: agents.fly(policy, NAME).actions[0] for name, policy in policies.items()}
tracks += [figures.replayed_track(scenario, actions, name) for name, actions in flights.items()]
figures.write_page(figures.paths(scenario, tracks, f"{NAME}: the optimum and the agents"), FOLDER / "paths.html")
figures.write_page(
    figures.learning(training.curve, best.k_star, f"{NAME}: PPO with a curriculum"), FOLDER / "learning.html"
)
print(f"pictures: {FOLDER / 'paths.html'}, {FOLDER / 'learning.html'}")

# %% [markdown]
# ## Result

# %%
results = {
    row["agent"]: f"in {row['steps']:.0f} steps, {row['gap']:+.1%} to K*"
    if row["success_rate"]
    else "without reaching the goal"
    for _, row in scores.iterrows()
}
conclusion = (
    f"After {ENV_STEPS:,} environment steps on {NAME!r} plain PPO flies {results['PPO']}, with the curriculum "
    f"{results['PPO, curriculum']}; the pretrained policy flies {results['pretrained']}. K* = {best.k_star} is "
    "proven: the remaining gap is the agent's."
)
print(conclusion)
