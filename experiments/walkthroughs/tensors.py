# %% [markdown]
# # For reinforcement learning on tensors: PPO in one file
#
# The vehicles are rows of PyTorch tensors, on any device. Observations, rewards and new episodes never leave it, and
# the learner reads them where they are. This is the whole of PPO in one file, scored against K*.
#
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
VEHICLES, ROLLOUT, ITERATIONS = (64, 16, 3) if QUICK else (1024, 32, 120)
EPOCHS, MINIBATCH, DISCOUNT, TRACE, CLIP, RATE = 6, VEHICLES * ROLLOUT // 8, 0.995, 0.95, 0.2, 1e-3
torch.manual_seed(0)
best = reference(NAME)
assert best is not None

# %% [markdown]
# ## The vehicles
#
# In mode SAME_STEP the step that ends an episode returns the first observation of the next one. The tolerance at the
# goal is wide at first and the true one in the last third of the training: few flights end there by chance.

# %%
scenario = flatgym.scenario(NAME)
stages = []
for factor in (4, 2, 1):
    task = replace(scenario, tolerance=Tolerance(*(factor * value for value in astuple(scenario.tolerance))))
    stages.append(FlatQuadTorchVectorEnv(VEHICLES, task, autoreset_mode="SameStep", device=DEVICE))
observation, _ = stages[0].reset(seed=0)

# %% [markdown]
# ## The networks
#
# A Gaussian policy whose deviations do not depend on the observation, and a value.


# %%
def network(outputs: int) -> Any:
    """Return a network of two hidden layers."""
    width = observation.shape[1]
    layers: list[Any] = [nn.Linear(width, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)]
    with torch.no_grad():
        layers[-1].weight.mul_(0.1)  # the first actions are near hover, the first values near zero
    return nn.Sequential(*layers).to(DEVICE)


actor, critic = network(2), network(1)
deviation = nn.Parameter(torch.full((2,), -0.5, device=DEVICE))
parameters = [*actor.parameters(), *critic.parameters(), deviation]
optimizer = torch.optim.Adam(parameters, lr=RATE, eps=1e-5)


def policy(observations: Any) -> Any:
    """Return the distribution of the actions, shape (..., 2)."""
    return torch.distributions.Normal(actor(observations), deviation.exp())


# %% [markdown]
# ## The rollout
#
# Advantages by generalised estimation (Schulman et al. 2016). An episode that the time limit ends goes on in the value
# of its last state, which `final_obs` holds.


# %%
@torch.no_grad()
def rollout(envs: Any, observation: Any) -> tuple[Any, ...]:
    """Return the next observation, and observations, actions, their log probabilities, advantages, returns."""
    steps = []
    for _ in range(ROLLOUT):
        action = policy(observation).sample()
        after, reward, terminated, truncated, infos = envs.step(action)
        if truncated.any():
            reward = reward + truncated * DISCOUNT * critic(infos["final_obs"])[:, 0]
        done = (terminated | truncated).float()
        log = policy(observation).log_prob(action).sum(-1)
        steps.append((observation, action, log, reward, done, critic(observation)[:, 0]))
        observation = after
    ahead, advantage, advantages = critic(observation)[:, 0], torch.zeros(VEHICLES, device=DEVICE), list[Any]()
    for _, _, _, reward, done, value in reversed(steps):
        advantage, ahead = reward + DISCOUNT * (1 - done) * (ahead + TRACE * advantage) - value, value
        advantages.insert(0, advantage)
    seen, actions, logs, _, _, values = (torch.stack(parts) for parts in zip(*steps, strict=True))
    gains = torch.stack(advantages)
    return observation, *(part.flatten(0, 1) for part in (seen, actions, logs, gains, gains + values))


# %% [markdown]
# ## The training

# %%
begun = time.perf_counter()
for iteration in range(ITERATIONS):
    optimizer.param_groups[0]["lr"] = RATE * (1 - iteration / ITERATIONS)
    envs = stages[3 * iteration // ITERATIONS]
    if not iteration % (ITERATIONS // 3):
        observation, _ = envs.reset(seed=iteration)
    observation, *batch = rollout(envs, observation)
    orders: Any = [torch.randperm(len(batch[0]), device=DEVICE) for _ in range(EPOCHS)]
    for rows in (rows for order in orders for rows in order.split(MINIBATCH)):
        seen, action, log, gain, target = (part[rows] for part in batch)
        ratio = (policy(seen).log_prob(action).sum(-1) - log).exp()
        gain = (gain - gain.mean()) / (gain.std() + 1e-8)
        gained = torch.minimum(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
        loss = 0.5 * (critic(seen)[:, 0] - target).square().mean() - gained
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, 0.5)
        optimizer.step()
seconds, env_steps = time.perf_counter() - begun, ITERATIONS * ROLLOUT * VEHICLES

# %% [markdown]
# ## The score, the picture and the result

# %%
learner = Adapted(actor.cpu())
score = agents.evaluate(learner, NAME, episodes=1, agent="PPO on tensors").iloc[0]
tracks = [figures.replayed_track(scenario, best.actions, "optimum")]
tracks.append(figures.replayed_track(scenario, agents.fly(learner, NAME).actions[0], "PPO on tensors"))
figures.write_page(figures.paths(scenario, tracks, f"{NAME}: the optimum and the agent"), FOLDER / "paths.html")
steps = f"in {score['steps']:.0f} steps, {score['gap']:+.1%} to K*" if score["success_rate"] else "short of its goal"
conclusion = (
    f"After {env_steps:,} environment steps in {seconds:.0f} s on {DEVICE}, PPO on tensors flies {NAME!r} "
    f"{steps}. K* = {best.k_star} is proven: the remaining gap is the agent's."
)
print(conclusion)
