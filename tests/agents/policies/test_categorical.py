"""The categorical actor: probabilities of bins, exact limits, and a policy like any other on disk and in export."""

import warnings
import zipfile

import gymnasium as gym
import numpy as np
import onnx
import pytest
import torch
from stable_baselines3 import A2C, PPO

from agents import fly, policies
from agents.policies import archive
from agents.policies.adapters import load_policy
from agents.policies.categorical import BinnedDistribution, CategoricalPolicy
from agents.policies.fingerprint import fingerprint
from agents.training.configs import PPOConfig, from_json
from agents.training.models import build
from agents.training.vec_env import make_vec_env

BINS = [(2, 3), (3, 21), (5, 7)]
SEEN = np.random.default_rng(0).uniform(-1, 1, (6, 19)).astype(np.float32)


def distribution(bins, count=4, seed=0):
    logits = torch.randn(count, sum(bins), generator=torch.Generator().manual_seed(seed))
    return BinnedDistribution(bins).proba_distribution(2 * logits)


def every_action(bins):
    return torch.cartesian_prod(*(torch.linspace(-1, 1, count) for count in bins))


def model(bins=(3, 21), **arguments):
    return build(PPOConfig(scenario="horizontal-3", num_envs=4, n_steps=8, batch_size=16, bins=bins, **arguments))


@pytest.fixture(scope="module")
def trained():
    return model(width=16).learn(64)


@pytest.mark.parametrize("bins", BINS)
def test_probabilities_of_all_bins_sum_to_one(bins):
    chosen = distribution(bins)
    total = sum(chosen.log_prob(action.expand(4, 2)).exp() for action in every_action(bins))
    torch.testing.assert_close(total, torch.ones(4))


@pytest.mark.parametrize("bins", BINS)
def test_entropy_and_mode_are_those_of_the_probabilities(bins):
    chosen, actions = distribution(bins), every_action(bins)
    logs = torch.stack([chosen.log_prob(action.expand(4, 2)) for action in actions])
    torch.testing.assert_close(chosen.entropy(), -(logs.exp() * logs).sum(dim=0))
    torch.testing.assert_close(chosen.mode(), actions[logs.argmax(dim=0)])


def test_samples_have_the_probabilities():
    chosen = distribution((3, 5), count=1)
    torch.manual_seed(0)
    many = (
        BinnedDistribution((3, 5))
        .proba_distribution(torch.cat(chosen.log_probabilities, dim=1).expand(40_000, -1))
        .sample()
    )
    for action in every_action((3, 5)):
        share = torch.isclose(many, action).all(dim=1).double().mean()
        assert share == pytest.approx(float(chosen.log_prob(action[None]).exp()), abs=0.01)


@pytest.mark.parametrize("bins", BINS)
def test_levels_hold_the_limits_and_zero_exactly_and_are_symmetric(bins):
    chosen = BinnedDistribution(bins)
    for i, count in enumerate(bins):
        numbers = torch.zeros(count, 2, dtype=torch.long)
        numbers[:, i] = torch.arange(count)
        levels = chosen.levels(numbers)
        assert torch.equal(chosen.numbers(levels), numbers)
        values = levels[:, i]
        assert (values[0], values[-1]) == (-1.0, 1.0)
        assert torch.equal(values, -values.flip(0))
        assert count % 2 == 0 or values[count // 2] == 0.0


def test_actions_lie_in_the_box_and_the_deterministic_one_is_the_mode(trained):
    box = trained.action_space
    for deterministic in (True, False):
        assert all(box.contains(action) for action in trained.predict(SEEN, deterministic=deterministic)[0])
    expected = trained.policy.get_distribution(torch.from_numpy(SEEN)).mode().numpy()
    np.testing.assert_array_equal(trained.predict(SEEN, deterministic=True)[0], expected)
    assert not hasattr(trained.policy, "log_std")


def test_a_policy_is_saved_and_loaded_with_its_bins(trained, tmp_path):
    path = policies.save(trained, tmp_path / "policy.zip", "horizontal-3")
    for found in (policies.load(path, trust=True), PPO.load(path, device="cpu")):
        assert isinstance(found.policy, CategoricalPolicy)
        assert found.policy.bins == (3, 21)
        np.testing.assert_array_equal(
            found.predict(SEEN, deterministic=True)[0], trained.predict(SEEN, deterministic=True)[0]
        )
    again = policies.save(policies.load(path, trust=True), tmp_path / "again.zip", "horizontal-3")
    assert fingerprint(again) == fingerprint(path)
    trained.policy.save(tmp_path / "weights.pt")
    alone = CategoricalPolicy.load(tmp_path / "weights.pt", device="cpu")
    np.testing.assert_array_equal(
        alone.predict(SEEN, deterministic=True)[0], trained.policy.predict(SEEN, deterministic=True)[0]
    )


class Deterministic(torch.nn.Module):
    """The deterministic actions of a policy."""

    def __init__(self, policy):
        super().__init__()
        self.policy = policy

    def forward(self, seen):
        return self.policy(seen, deterministic=True)[0]


@pytest.mark.parametrize("suffix", [".pt", ".onnx"])
def test_an_exported_policy_flies_alike(trained, tmp_path, suffix):
    path, module = tmp_path / f"policy{suffix}", Deterministic(trained.policy.eval())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        if suffix == ".pt":
            torch.jit.save(torch.jit.trace(module, torch.zeros(2, 19)), str(path))
        else:
            torch.onnx.export(
                module, (torch.zeros(2, 19),), path, input_names=["seen"], dynamic_axes={"seen": {0: "n"}}, dynamo=False
            )
            onnx.checker.check_model(onnx.load(path))
    exported = load_policy(str(path))
    np.testing.assert_allclose(exported.predict(SEEN)[0], trained.predict(SEEN, deterministic=True)[0], atol=1e-6)
    assert fly(exported, "horizontal-3").outcomes == fly(trained, "horizontal-3").outcomes


def test_other_algorithms_take_the_policy_too():
    envs = make_vec_env("horizontal-3", 2, seed=0)
    learner = A2C(CategoricalPolicy, envs, policy_kwargs={"bins": (2, 5)}, n_steps=4, device="cpu", seed=0)
    assert set(np.unique(np.abs(learner.learn(16).predict(SEEN)[0]))) <= {0.0, 0.5, 1.0}


def test_a_training_starts_from_a_policy_with_the_bins_of_that_policy(trained, tmp_path):
    path = policies.save(trained, tmp_path / "start.zip")
    for bins in ((5, 7), None):
        started = model(bins, policy=str(path))
        assert started.policy.bins == (3, 21)
        assert all(
            torch.equal(a, b) for a, b in zip(started.policy.parameters(), trained.policy.parameters(), strict=True)
        )
    gaussian = policies.save(model(None), tmp_path / "gaussian.zip")
    assert not isinstance(model((3, 21), policy=str(gaussian)).policy, CategoricalPolicy)


def test_bins_survive_the_text_of_a_configuration():
    for bins in ((5, 7), None):
        config = PPOConfig(bins=bins)
        assert from_json(config.to_json()) == config
        assert hash(from_json(config.to_json())) == hash(config)


@pytest.mark.parametrize(
    ("bins", "words"),
    [
        ((3, 20), "odd number of rate bins, to hold the rate zero"),
        ((1, 21), r"bins must be a whole number in 2\.\."),
        ((3, 1), r"bins must be a whole number in 3\.\."),
        ((3.0, 21), "must be a whole number"),
        ((3,), "two numbers of bins, of thrust and of rate, or None"),
        ("3x21", "two numbers of bins, of thrust and of rate, or None"),
    ],
)
def test_bad_bins_are_named(bins, words):
    with pytest.raises(ValueError, match=words):
        PPOConfig(bins=bins)


def test_another_action_space_is_refused():
    with pytest.raises(ValueError, match=r"action_space of shape \(1,\).*train it in FlatQuad-v0"):
        PPO(CategoricalPolicy, gym.make("Pendulum-v1"), n_steps=8, batch_size=8, device="cpu")


def test_a_policy_class_of_another_version_is_named_with_the_way_out(trained, tmp_path, monkeypatch):
    path = policies.save(trained, tmp_path / "later.zip")
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    members[archive.CARD] = members[archive.CARD].replace(b'"flatgym": "', b'"flatgym": "9.')
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    monkeypatch.delattr("agents.policies.categorical.CategoricalPolicy")
    with pytest.raises(ValueError, match=r"later\.zip is not .*CategoricalPolicy.*flatgym 9\..* wrote it, and this is"):
        policies.load(path, trust=True)
