"""Threads of torch: a training leaves as many as it found, also when it fails."""

from dataclasses import replace

import pytest
import torch

from agents.training.configs import PPOConfig
from agents.training.threads import torch_threads
from agents.training.train import train
from experiments.recipes import run_spec
from experiments.recipes.imitation import train_bc, train_dagger
from experiments.recipes.run_spec import RunSpec

TINY = PPOConfig(
    scenario="horizontal-3", env_steps=64, num_envs=4, n_steps=8, batch_size=16, n_epochs=1, width=8, eval_every=99
)
BUDGET = replace(run_spec.SMOKE, gradient_steps=(3, 3), rounds=(1, 1), round_gradient_steps=(3, 3))


@pytest.fixture(autouse=True)
def three_threads():
    """Three threads, a number that no training asks for."""
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(before)


def test_threads_are_given_back_after_an_error_too():
    with pytest.raises(RuntimeError, match="on purpose"), torch_threads(2):  # noqa: PT012 - the threads inside count
        assert torch.get_num_threads() == 2
        raise RuntimeError("on purpose")
    assert torch.get_num_threads() == 3


@pytest.mark.parametrize("recipe", [train_bc, train_dagger])
def test_imitation_gives_them_back(tmp_path, recipe):
    assert recipe(RunSpec("horizontal-3", 0, tmp_path, BUDGET)).algorithm in ("BC", "DAgger")
    assert torch.get_num_threads() == 3


def test_reinforcement_learning_gives_them_back(tmp_path):
    used = []
    config = replace(TINY, folder=str(tmp_path / "run"))
    train(config, on_validation=lambda _: used.append(torch.get_num_threads()))
    assert set(used) == {1}
    assert torch.get_num_threads() == 3
    with pytest.raises(ValueError, match="must be a file or one of the pretrained policies"):
        train(replace(config, policy="nothing.zip", folder=str(tmp_path / "another")))
    assert torch.get_num_threads() == 3
