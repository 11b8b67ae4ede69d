"""Behaviour cloning: the loss at limits, minibatches, fitting, reproducibility, and fine-tuning with PPO."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from agents import policies
from agents.imitation.cloning import CloneConfig, batches, clone, fit, loss, losses, untrained_policy
from agents.imitation.dataset import ExpertData
from agents.training.configs import PPOConfig
from agents.training.train import train

SMALL = CloneConfig(scenario="horizontal-3", width=32, depth=2, batch_size=128, gradient_steps=300)


def test_beyond_the_limit_of_the_action_the_loss_is_zero():
    output = torch.tensor([[1.7, -0.5], [-3.0, 0.9], [0.5, -1.0]])
    action = torch.tensor([[1.0, 1.0], [-1.0, 0.5], [1.0, 1.0]])
    expected = torch.tensor([[0.0, 2.25], [0.0, 0.16], [0.25, 4.0]])
    torch.testing.assert_close(loss(output, action), expected)


def test_a_categorical_actor_keeps_two_experts_apart_that_the_squared_error_averages():
    observations = np.zeros((64, 19), dtype=np.float32)
    rates = np.tile([-1.0, 1.0, 1.0, -1.0], 16)
    data = ExpertData(observations, np.stack([np.ones(64), rates], axis=1).astype(np.float32))
    acted = {
        bins: clone(data, replace(SMALL, bins=bins, gradient_steps=100)).predict(observations[:1], deterministic=True)[
            0
        ]
        for bins in (None, (3, 21))
    }
    assert abs(acted[None][0, 1]) < 0.2
    assert abs(acted[3, 21][0, 1]) == 1.0


@pytest.mark.parametrize("bins", [None, (3, 41)])
def test_losses_are_lower_for_the_labels_of_the_expert_than_for_the_opposite(data, bins):
    model = clone(data, replace(SMALL, bins=bins))
    observations, actions = map(torch.from_numpy, (data.observations, data.actions))
    own, other = (losses(model, observations, labels).mean() for labels in (actions, -actions))
    assert own < other / 3


def test_batches_use_all_rows_equally():
    rows = torch.cat(list(batches(100, replace(SMALL, batch_size=30, gradient_steps=10))))
    assert len(rows) == 300
    assert torch.bincount(rows, minlength=100).min() >= 2


def test_fitting_lowers_the_error_and_leaves_the_critic_unchanged(data):
    model = untrained_policy(SMALL)
    critic = [value.clone() for value in model.policy.mlp_extractor.value_net.parameters()]
    first = fit(model, data, replace(SMALL, gradient_steps=10))
    assert fit(model, data, SMALL) < first / 3
    for before, after in zip(critic, model.policy.mlp_extractor.value_net.parameters(), strict=True):
        torch.testing.assert_close(before, after, rtol=0, atol=0)


def test_the_seed_determines_the_clone(data):
    brief = replace(SMALL, gradient_steps=20)
    one, same, other = (clone(data, config) for config in (brief, brief, replace(brief, seed=1)))
    actions = [model.predict(data.observations, deterministic=True)[0] for model in (one, same, other)]
    np.testing.assert_array_equal(actions[0], actions[1])
    assert not np.allclose(actions[0], actions[2])


def test_a_clone_is_saved_and_fine_tuned_with_ppo(data, tmp_path):
    model = clone(data, replace(SMALL, gradient_steps=20))
    file = policies.save(model, tmp_path / "clone.zip", "horizontal-3")
    loaded = policies.load(file, trust=True)
    expected = model.predict(data.observations, deterministic=True)[0]
    np.testing.assert_array_equal(loaded.predict(data.observations, deterministic=True)[0], expected)
    tuned = train(
        PPOConfig(
            scenario="horizontal-3", policy=str(file), num_envs=16, n_steps=16, batch_size=128, env_steps=512,
            folder=str(tmp_path / "ppo"),
        )
    )  # fmt: skip
    assert tuned.env_steps == 512


@pytest.mark.parametrize(
    ("field", "value"), [("gradient_steps", 0), ("observation_scale", -1.0), ("seed", 1.5), ("scenario", "nowhere")]
)
def test_invalid_fields_are_named(field, value):
    with pytest.raises(ValueError, match=field if field != "scenario" else "nowhere"):
        CloneConfig(**{field: value})
