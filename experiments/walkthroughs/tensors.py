# %% [markdown]
# # For reinforcement learning on tensors: PPO in one file
#
# The vehicles are rows of PyTorch tensors, on any device. Observations, rewards and new episodes never leave it, and
# the learner reads them where they are. This is the whole of PPO in one file, scored against K*.
# Run it cell by cell, or as a whole: `python -m experiments.walkthroughs.tensors`, with `--quick` in seconds.

# %%
"""Walk-through for learning on tensors: a batch of vehicles on the device, PPO from scratch, the score against K*."""

import sys
import time
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

import agents
import flatgym
from agents.policies.adapters import Adapted
from experiments import figures
from flatgym import Tolerance
from flatgym.envs.torch_vector import FlatQuadTorchVectorEnv
from flatgym.scenarios.reference import reference

QUICK = "--quick" in sys.argv
NAME = "horizontal-3"
FOLDER = Path("experiments/results/walkthroughs/tensors")
FOLDER.mkdir(parents=True, exist_ok=True)
DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
VEHICLES, ROLLOUT, ITERATIONS = (64, 16, 3) if QUICK else (1024, 16, 300)
EPOCHS, MINIBATCH, DISCOUNT, TRACE, CLIP, RATE = 6, VEHICLES * ROLLOUT // 8, 0.99, 0.95, 0.2, 1e-3
FAILURE, SCALE = -0.5, 3.0  # reward of a failed episode, milder than the environment's; scale of the observations
ACTIONS = torch.cartesian_prod(torch.linspace(-1, 1, 2), torch.linspace(-1, 1, 11)).to(DEVICE)  # of thrust and rate
torch.manual_seed(0)
best = reference(NAME)
assert best is not None

# %% [markdown]
# ## The vehicles
#
# In mode SAME_STEP the step that ends an episode returns the first observation of the next one. Few flights end at the
# goal by chance. So the tolerance there is wide at first and the true one in the last third of the training, and half
# of the vehicles start each rollout in states flown backwards from the goal under random controls.

# %%
scenario = flatgym.scenario(NAME)
stages = []
for factor in (4, 2, 1):
    task = replace(scenario, tolerance=Tolerance(*(factor * part for part in astuple(scenario.tolerance))))
    stages.append(FlatQuadTorchVectorEnv(VEHICLES, task, autoreset_mode="SameStep", device=DEVICE))
observation, _ = stages[0].reset(seed=0)
pool = torch.as_tensor(agents.backward_starts(scenario).state)

# %% [markdown]
# ## The networks: a categorical policy over pairs of levels of thrust and rate, and a value

# %%
width = observation.shape[1]
actor, critic = (
    nn.Sequential(nn.Linear(width, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)).to(DEVICE)
    for outputs in (len(ACTIONS), 1)
)
optimizer = torch.optim.Adam(parameters := [*actor.parameters(), *critic.parameters()], lr=RATE, eps=1e-5)


def policy(observations: Any) -> Any:
    """Return the distribution of the numbers of the actions, of shape (n,)."""
    return torch.distributions.Categorical(logits=actor(SCALE * observations))


def value(observations: Any) -> Any:
    """Return the values, shape (n,)."""
    return critic(SCALE * observations)[:, 0]


# %% [markdown]
# ## The rollout
#
# Advantages by generalised estimation (Schulman et al. 2016). A truncated episode goes on in the value of `final_obs`.


# %%
@torch.no_grad()
def rollout(envs: Any, observation: Any) -> tuple[Any, ...]:
    """Return the next observation, and observations, actions, their log probabilities, advantages, returns."""
    steps = []
    for _ in range(ROLLOUT):
        chosen = policy(observation).sample()
        after, reward, terminated, truncated, infos = envs.step(ACTIONS[chosen])
        if terminated.any():
            reward = torch.where(terminated & ~infos["final_info"]["is_success"], FAILURE, reward)
        if truncated.any():
            reward = reward + truncated * DISCOUNT * value(infos["final_obs"])
        done = (terminated | truncated).float()
        steps.append((observation, chosen, policy(observation).log_prob(chosen), reward, done, value(observation)))
        observation = after
    ahead, advantage, advantages = value(observation), torch.zeros(VEHICLES, device=DEVICE), list[Any]()
    for _, _, _, reward, done, here in reversed(steps):
        advantage, ahead = reward + DISCOUNT * (1 - done) * (ahead + TRACE * advantage) - here, here
        advantages.insert(0, advantage)
    seen, chosen, logs, _, _, values = (torch.stack(parts) for parts in zip(*steps, strict=True))
    gains = torch.stack(advantages)
    return observation, *(part.flatten(0, 1) for part in (seen, chosen, logs, gains, gains + values))


# %% [markdown]
# ## The training

# %%
begun = time.perf_counter()
for iteration in range(ITERATIONS):
    optimizer.param_groups[0]["lr"] = RATE * (1 - iteration / ITERATIONS)
    envs = stages[3 * iteration // ITERATIONS]
    if not iteration % (ITERATIONS // 3):
        observation, _ = envs.reset(seed=iteration)
    starts = pool[torch.randint(len(pool), (VEHICLES,))]
    observation, _ = envs.reset(options={"state": starts, "reset_mask": torch.arange(VEHICLES) % 2 == 0})
    observation, *batch = rollout(envs, observation)
    orders: Any = [torch.randperm(len(batch[0]), device=DEVICE) for _ in range(EPOCHS)]
    for rows in (rows for order in orders for rows in order.split(MINIBATCH)):
        seen, chosen, log, gain, target = (part[rows] for part in batch)
        ratio = (policy(seen).log_prob(chosen) - log).exp()
        gain = (gain - gain.mean()) / (gain.std() + 1e-8)
        gained = torch.minimum(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
        loss = 0.5 * (value(seen) - target).square().mean() - gained
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, 0.5)
        optimizer.step()
seconds, env_steps = time.perf_counter() - begun, ITERATIONS * ROLLOUT * VEHICLES

# %% [markdown]
# ## The score, the picture and the result

# %%
learner = Adapted(lambda seen: ACTIONS[policy(torch.as_tensor(seen, device=DEVICE)).probs.argmax(-1)])
score = agents.evaluate(learner, NAME, episodes=1, agent="PPO on tensors").iloc[0]
flown = {"optimum": best.actions, "PPO on tensors": agents.fly(learner, NAME).actions[0]}
tracks = [figures.replayed_track(scenario, actions, name) for name, actions in flown.items()]
figures.write_page(figures.paths(scenario, tracks, f"{NAME}: the optimum and the agent"), FOLDER / "paths.html")
steps = f"in {score['steps']:.0f} steps, {score['gap']:+.1%} to K*" if score["success_rate"] else "short of its goal"
conclusion = (
    f"After {env_steps:,} environment steps in {seconds:.0f} s on {DEVICE}, PPO on tensors flies {NAME!r} "
    f"{steps}. K* = {best.k_star} is proven: the remaining gap is the agent's."
)
print(conclusion)
