# %% [markdown]
# # For imitation: from optimal flights to a policy
#
# Imitation learning needs an expert. Here every task has one: flights in K* steps, the fewest possible. We record
# flights as a Minari dataset, clone a policy from them, and see where cloning fails. Then we improve the policy by two
# methods: DAgger queries the expert again, PPO uses the reward alone.
#
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.imitation`, with `--quick` in seconds.

# %%
"""Walk-through for imitation learning: record demonstrations, clone, score, DAgger, fine-tune with PPO."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import pandas as pd
import torch
from stable_baselines3 import PPO

import agents
import optimal
from agents.imitation.cloning import CloneConfig, clone
from agents.imitation.dataset import load_expert_data
from agents.imitation.dataset_aggregation import DaggerConfig, dagger
from agents.imitation.selection import BestPolicy
from agents.policies.policy import Policy
from experiments import figures
from flatgym import SCENARIOS, Disturbances

QUICK = "--quick" in sys.argv
NAME = "horizontal-3" if QUICK else "hoop"
FOLDER = Path("experiments/results/walkthroughs/imitation")
FOLDER.mkdir(parents=True, exist_ok=True)
os.environ.setdefault("MINARI_DATASETS_PATH", str((FOLDER / "minari").resolve()))  # the default is in your home folder
torch.set_num_threads(1)  # small networks: a second thread slows them down

# %% [markdown]
# ## Demonstrations
#
# The first flight is the scenario's own, in K* steps. The others start near its start. Perturbed copies of each flight
# are replanned from the perturbed state: the data must show how to recover from an error.

# %%
planned = agents.demonstrations.plan(NAME, 3 if QUICK else 8, perturbed=1 if QUICK else 3, jobs=1)
dataset = agents.demonstrations.record(NAME, planned, f"walkthrough/{NAME}", if_exists="replace")
replays = agents.demonstrations.replay(dataset)
k_star = planned[0].steps
print(f"{dataset.id}: {dataset.total_episodes} flights, {dataset.total_steps} steps, K* = {k_star}")
print(f"replayed in the environment, {sum(one.outcome == 'goal' for one in replays)} of them reach the goal")

# %% [markdown]
# ## Cloning
#
# Behaviour cloning fits the actions to the observations. The policy is a Stable-Baselines3 PPO, saved as a small zip.

# %%
expert_data = load_expert_data(dataset, NAME)
cloned = clone(expert_data, CloneConfig(scenario=NAME, gradient_steps=100 if QUICK else 4000))
cloned_file = agents.policies.save(cloned, FOLDER / "cloned.zip", NAME)
print(f"{len(expert_data.actions)} expert labels; the policy is in {cloned_file}")

# %% [markdown]
# ## The score
#
# A score has two parts: the success rate, and the gap K / K* - 1 of the successful episodes. We evaluate the nominal
# vehicle, and the vehicle in wind, which is not in the training data. A tail wind can make the gap negative.
#
# The demonstrations cover few states. Outside of them the clone has no data and fails.

# %%
wind = Disturbances(wind=0.5)


def scored(name: str, policy: Policy) -> dict[str, object]:
    """Return a row of the table: one nominal episode, because it is deterministic, and many in wind."""
    nominal = agents.evaluate(policy, NAME, episodes=1).iloc[0]
    windy = agents.evaluate(policy, NAME, episodes=4 if QUICK else 100, disturbances=wind).iloc[0]
    return {
        "agent": name,
        "success": nominal["success_rate"],
        "steps": nominal["steps"],
        "K*": nominal["k_star"],
        "gap": nominal["gap"],
        "success in wind": windy["success_rate"],
        "gap in wind": windy["gap"],
    }


scores = [scored("cloned", cloned)]
print(pd.DataFrame(scores).to_string(index=False))

# %% [markdown]
# ## DAgger
#
# The policy is rolled out, and the expert labels the states it visits. The expert is an LQR around an optimal flight,
# which gives a label in every state. If the scenario has hoops, the flight is planned through narrower ones: it takes
# no more steps, and small errors still pass the hoop. Each round adds data; the policy of the best round is stored.

# %%
scenario = SCENARIOS[NAME]
narrow = scenario.with_diameters(0.4 * hoop.diameter for hoop in scenario.hoops)
robust_flight = replace(optimal.fewest_steps(narrow, time_budget=0.0), scenario=scenario)
expert = agents.Expert(robust_flight, max_lag=1)
rounds = DaggerConfig(scenario=NAME, rounds=2 if QUICK else 8, gradient_steps=100 if QUICK else 2000)
best = BestPolicy(rounds, target=k_star)
oracle = agents.lqr_oracle([robust_flight], count=4 if QUICK else 32)
dagger_policy = dagger(PPO.load(cloned_file, device="cpu"), oracle, rounds, best)
agents.policies.save(dagger_policy, FOLDER / "dagger.zip", NAME)
print(pd.DataFrame(best.curve)[["env_steps", "outcome", "steps"]].to_string())
scores += [scored("DAgger", dagger_policy), scored("expert", expert)]

# %% [markdown]
# ## Fine-tuning with PPO
#
# PPO needs the reward only. It starts from the cloned policy, with little exploration noise and small updates, which
# preserve what the policy has learned. There is no curriculum: the tolerance is the true one, all starts are at rest.

# %%
config = agents.PPOConfig(
    scenario=NAME,
    policy=str(cloned_file),
    env_steps=2048 if QUICK else 600_000,
    num_envs=16 if QUICK else 256,
    n_steps=16 if QUICK else 64,
    batch_size=128 if QUICK else 4096,
    tolerance=1.0,
    pool_share=0.0,
    pool_share_end=0.0,
    log_std_init=-2.5,
    learning_rate=1e-4,
    target_kl=0.005,
    folder=str(FOLDER / "ppo"),
)
training = agents.train(config, optimum=k_star, overwrite=True)
tuned = agents.policies.load(training.model, trust=True)
print(pd.DataFrame(training.curve)[["env_steps", "outcome", "steps"]].to_string())
scores += [scored("cloned, then PPO", tuned)]

# %% [markdown]
# ## The picture
#
# The demonstration and all three policies on the same scenario.

# %%
policies = {"cloned": cloned, "DAgger": dagger_policy, "cloned, then PPO": tuned}
flights = {name: agents.fly(policy, NAME).actions[0] for name, policy in policies.items()}
tracks = [figures.replayed_track(scenario, planned[0].flight.actions, "demonstrated")]
tracks += [figures.replayed_track(scenario, actions, name) for name, actions in flights.items()]
figures.write_page(figures.paths(scenario, tracks, f"{NAME}: demonstrated and learned"), FOLDER / "paths.html")
print(f"picture: {FOLDER / 'paths.html'}")

# %% [markdown]
# ## Result

# %%
table = pd.DataFrame(scores)
print(table.to_string(index=False))
results = {
    row["agent"]: f"in {row['steps']:.0f} steps, {row['gap']:+.1%} to K*"
    if row["success"]
    else "without reaching the goal"
    for row in scores
}
conclusion = (
    f"After {dataset.total_episodes} optimal flights of {NAME!r} the clone flies {results['cloned']}. DAgger, with "
    f"expert labels for {best.env_steps:,} more steps, gives a policy that flies {results['DAgger']}; "
    f"{training.env_steps:,} steps of PPO give one that flies {results['cloned, then PPO']}."
)
print(conclusion)
