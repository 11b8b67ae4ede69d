# %% [markdown]
# # For imitation: from optimal flights to a policy
#
# Who imitates needs an expert. Here there is one for every task: flights in the fewest steps that are possible. We
# record some as a Minari dataset, clone a policy from them, see where cloning fails, and mend it on two roads: DAgger,
# which asks the expert again, and PPO, which goes on by reward alone.
#
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.imitation`, with `--quick` in seconds.

# %%
"""The imitator's walk-through: record demonstrations, clone, score, DAgger, and on with PPO."""

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
os.environ.setdefault("MINARI_DATASETS_PATH", str((FOLDER / "minari").resolve()))  # else they lie in your home
torch.set_num_threads(1)  # small networks: a second thread costs more than it gives

# %% [markdown]
# ## Demonstrations
#
# The first flight is the scenario's own, in K* steps. The others begin a little away from its start, and each is
# knocked off its way as well and planned anew from there: a learner has to see how one comes back.

# %%
planned = agents.demonstrations.plan(NAME, 3 if QUICK else 8, perturbed=1 if QUICK else 3, jobs=1)
dataset = agents.demonstrations.record(NAME, planned)
replays = agents.demonstrations.replay(dataset)
k_star = planned[0].steps
print(f"{dataset.id}: {dataset.total_episodes} flights, {dataset.total_steps} steps, K* = {k_star}")
print(f"flown anew in the environment, {sum(one.outcome == 'goal' for one in replays)} of them reach the goal")

# %% [markdown]
# ## Cloning
#
# Behaviour cloning fits the actions to the observations. What comes out is a PPO of Stable-Baselines3, in a small zip.

# %%
shown = load_expert_data(dataset, NAME)
cloned = clone(shown, CloneConfig(scenario=NAME, gradient_steps=100 if QUICK else 4000))
cloned_file = agents.policies.save(cloned, FOLDER / "cloned.zip", NAME)
print(f"{len(shown.actions)} pairs were shown; the policy is in {cloned_file}")

# %% [markdown]
# ## The score
#
# A score is the success rate and the gap K / K* - 1 of the flights that succeed, never one without the other. Beside
# the calm we fly in wind, which nobody has met in training; there a tail wind may well help.
#
# Few flights were shown, and they say nothing of places where no expert ever was. There a clone is lost.

# %%
wind = Disturbances(wind=0.5)


def scored(name: str, policy: Policy) -> dict[str, object]:
    """Return a row of the table: one flight in the calm, which tells all there, and many in wind."""
    calm = agents.evaluate(policy, NAME, episodes=1).iloc[0]
    windy = agents.evaluate(policy, NAME, episodes=4 if QUICK else 100, disturbances=wind).iloc[0]
    return {
        "agent": name,
        "success": calm["success_rate"],
        "steps": calm["steps"],
        "K*": calm["k_star"],
        "gap": calm["gap"],
        "success in wind": windy["success_rate"],
        "gap in wind": windy["gap"],
    }


scores = [scored("cloned", cloned)]
print(pd.DataFrame(scores).to_string(index=False))

# %% [markdown]
# ## DAgger
#
# The learner flies, and the expert says what it would have done where the learner came to. Here the expert is a
# regulator about an optimal flight, so that it has an answer everywhere. The flight is planned through narrower hoops,
# if there are any: it takes no step more, and who errs a little still flies through. Each round adds to what was shown
# before; the policy of the best round is kept.

# %%
scenario = SCENARIOS[NAME]
narrow = scenario.with_diameters(0.4 * hoop.diameter for hoop in scenario.hoops)
taught = replace(optimal.fewest_steps(narrow, time_budget=0.0), scenario=scenario)
expert = agents.Expert(taught, max_lag=1)
rounds = DaggerConfig(scenario=NAME, rounds=2 if QUICK else 8, gradient_steps=100 if QUICK else 2000)
keeper = BestPolicy(rounds, target=k_star)
adviser = agents.lqr_oracle([taught], count=4 if QUICK else 32)
advised = dagger(PPO.load(cloned_file, device="cpu"), adviser, rounds, keeper)
agents.policies.save(advised, FOLDER / "advised.zip", NAME)
print(pd.DataFrame(keeper.curve)[["env_steps", "outcome", "steps"]].to_string())
scores += [scored("DAgger", advised), scored("expert", expert)]

# %% [markdown]
# ## On with PPO
#
# Without an expert at hand the reward has to do. PPO starts from the cloned policy, with little noise and small
# updates, so as not to forget what was learnt, and on the true task: no easier tolerance, no starts near the goal.

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
training = agents.train(config, optimum=k_star)
tuned = agents.policies.load(training.model, trust=True)
print(pd.DataFrame(training.curve)[["env_steps", "outcome", "steps"]].to_string())
scores += [scored("cloned, then PPO", tuned)]

# %% [markdown]
# ## The picture
#
# All fly the same scenario: the demonstration, the clone, and the clone mended on either road.

# %%
policies = {"cloned": cloned, "DAgger": advised, "cloned, then PPO": tuned}
flights = {name: agents.fly(policy, NAME).actions[0] for name, policy in policies.items()}
tracks = [figures.flown_track(scenario, planned[0].flight.actions, "demonstrated")]
tracks += [figures.flown_track(scenario, actions, name) for name, actions in flights.items()]
figures.write(figures.paths(scenario, tracks, f"{NAME}: shown, cloned, mended"), FOLDER / "paths.html")
print(f"picture: {FOLDER / 'paths.html'}")

# %% [markdown]
# ## What was learnt

# %%
table = pd.DataFrame(scores)
print(table.to_string(index=False))
said = {
    row["agent"]: f"in {row['steps']:.0f} steps, {row['gap']:+.1%} to K*" if row["success"] else "astray"
    for row in scores
}
learnt = (
    f"After {dataset.total_episodes} optimal flights of {NAME!r} the clone flies {said['cloned']}. Advice along "
    f"{keeper.env_steps:,} steps of its own has it fly {said['DAgger']}; {training.env_steps:,} steps of reward alone "
    f"{said['cloned, then PPO']}."
)
print(learnt)
