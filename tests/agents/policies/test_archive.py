"""Policies on disk: exact round trip, small files, no untrusted code, no damaged files."""

import base64
import errno
import io
import json
import pickle
import re
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3
import torch
from stable_baselines3 import DQN, PPO

from agents import policies
from agents.policies import algorithms, archive, compact
from agents.training.configs import CONFIGS, PPOConfig, config_of
from agents.training.models import build
from agents.training.vec_env import make_vec_env

SMALL = {"scenario": "horizontal-3", "num_envs": 4, "width": 8, "batch_size": 16}
OBSERVATIONS = np.random.default_rng(0).uniform(-1, 1, (5, 19)).astype(np.float32)


def small(algorithm, **values):
    memory = {} if algorithm == "PPO" else {"buffer_size": 500, "learning_starts": 8, "gradient_steps": 1}
    return build(config_of(algorithm, **SMALL | memory | values))


def trained(algorithm):
    """Return a model with the state of a training."""
    return small(algorithm).learn(64)


@pytest.fixture(scope="module")
def models():
    return {algorithm: trained(algorithm) for algorithm in CONFIGS}


@pytest.fixture
def file(models, tmp_path):
    return policies.save(models["PPO"], tmp_path / "policy.zip", "horizontal-3")


def actions(model):
    return model.predict(OBSERVATIONS, deterministic=True)[0]


@pytest.mark.parametrize("algorithm", CONFIGS)
def test_a_saved_policy_returns_the_same_actions(models, tmp_path, algorithm):
    path = policies.save(models[algorithm], tmp_path / "deep" / "policy.zip", "horizontal-3")
    found = policies.load(path, trust=True)
    assert type(found).__name__ == algorithm
    np.testing.assert_array_equal(actions(found), actions(models[algorithm]))
    np.testing.assert_array_equal(actions(type(found).load(path, device="cpu")), actions(models[algorithm]))
    said = policies.describe(path)
    assert (said["algorithm"], said["scenario"], len(said["observations"])) == (algorithm, "horizontal-3", 19)
    assert [other.name for other in path.parent.iterdir()] == ["policy.zip"]


@pytest.mark.parametrize("algorithm", CONFIGS)
def test_zips_of_stable_baselines3_are_loaded(models, tmp_path, algorithm):
    models[algorithm].save(tmp_path / "foreign.zip")
    found = policies.load(tmp_path / "foreign.zip", trust=True)
    assert type(found).__name__ == algorithm
    np.testing.assert_array_equal(actions(found), actions(models[algorithm]))


def test_saving_a_loaded_policy_gives_the_same_file(file, tmp_path):
    again = policies.save(policies.load(file, trust=True), tmp_path / "again.zip", "horizontal-3")
    assert again.read_bytes() == file.read_bytes()


def test_a_policy_of_the_default_size_is_small(tmp_path):
    model = build(PPOConfig(num_envs=1, batch_size=64))
    assert policies.save(model, tmp_path / "policy.zip").stat().st_size < 60_000


def test_rounding_halves_the_file_and_is_exact_on_disk(tmp_path):
    model = build(PPOConfig(scenario="horizontal-3", num_envs=4, batch_size=16, width=128))
    long = policies.save(model, tmp_path / "long.zip").stat().st_size
    before = actions(model)
    rounded = compact.rounded(model)
    short = policies.save(rounded, tmp_path / "short.zip")
    assert short.stat().st_size < 0.6 * long
    np.testing.assert_allclose(actions(rounded), before, atol=5e-3)
    assert all(value.dtype == torch.float32 for value in rounded.policy.parameters())
    for found in (policies.load(short, trust=True), PPO.load(short, device="cpu")):
        assert all(value.dtype == torch.float32 for value in found.policy.parameters())
        np.testing.assert_array_equal(actions(found), actions(rounded))


def test_the_state_of_the_training_is_not_saved(file, models):
    with zipfile.ZipFile(file) as members:
        optimizer = torch.load(io.BytesIO(members.read("policy.optimizer.pth")), weights_only=True)
        assert optimizer["state"] == {}
        assert not set(compact.TRANSIENT) & set(json.loads(members.read("data")))
        assert "system_info.txt" not in members.namelist()
    assert models["PPO"].policy.optimizer.state_dict()["state"], "the model itself is unchanged"


def test_another_algorithm_is_not_saved(tmp_path):
    class Own(PPO):
        pass

    model = Own("MlpPolicy", make_vec_env("hoop", 1), n_steps=8, batch_size=8, device="cpu")
    with pytest.raises(ValueError, match="unknown algorithm 'Own'; known: PPO, A2C, SAC, TD3, DDPG, TQC"):
        policies.save(model, tmp_path / "policy.zip")


class Trap:
    """An object that creates a file when unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_untrusted_files_are_refused_before_they_run_code(file, tmp_path):
    trap = tmp_path / "sprung"
    with zipfile.ZipFile(file) as members:
        contents = {name: members.read(name) for name in members.namelist()}
    data = json.loads(contents["data"])
    data["clip_range"] = {":type:": "x", ":serialized:": _base64(pickle.dumps(Trap(trap)))}
    with zipfile.ZipFile(file, "w") as members:
        for name, content in (contents | {"data": json.dumps(data).encode()}).items():
            members.writestr(name, content)
    assert policies.describe(file)["algorithm"] == "PPO"
    with pytest.raises(ValueError, match=r"executes code.*trust=True") as error:
        policies.load(file)
    assert str(file) in str(error.value)
    assert not trap.exists()


def _base64(content):

    return base64.b64encode(content).decode()


def test_files_of_the_package_are_loaded_by_name(models, tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "PRETRAINED", tmp_path / "pretrained")
    policies.save(models["PPO"], tmp_path / "pretrained" / "near.zip")
    policies.save(models["SAC"], tmp_path / "pretrained" / "far.zip")
    assert policies.names() == ("far", "near")
    np.testing.assert_array_equal(actions(policies.pretrained("near")), actions(models["PPO"]))
    with pytest.raises(ValueError, match=r"unknown pretrained policy '\.\./near'; known: far, near"):
        policies.pretrained("../near")


def test_a_link_out_of_the_package_is_untrusted(file, tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "PRETRAINED", tmp_path / "pretrained")
    (tmp_path / "pretrained").mkdir()
    (tmp_path / "pretrained" / "link.zip").symlink_to(file)
    with pytest.raises(ValueError, match="trust=True"):
        policies.pretrained("link")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_truncated_files_are_named(file, share):
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(ValueError, match=r"policy\.zip is not a whole zip"):
        policies.load(file, trust=True)


@pytest.mark.parametrize("place", np.linspace(0.02, 0.98, 25))
def test_a_corrupt_byte_is_detected_unless_it_is_that_of_a_date(file, place):
    content, before = bytearray(file.read_bytes()), _members(file)
    content[int(len(content) * place)] ^= 0xFF
    file.write_bytes(content)
    said = _refusal(file)
    assert re.search(r"policy.zip is (damaged|not a whole zip)", said) if said else _members(file) == before


def _refusal(path):
    try:
        policies.load(path, trust=True)
    except ValueError as error:
        return str(error)
    return ""


def _members(path):
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


@pytest.mark.parametrize("members", [{}, {"a.txt": "hello"}, {"data": "[]"}, {"data": "{"}])
def test_a_zip_of_something_else_is_named(tmp_path, members):
    path = tmp_path / "other.zip"
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    with pytest.raises(ValueError, match=r"other\.zip is"):
        policies.load(path, trust=True)


def test_another_algorithm_is_not_loaded(tmp_path):
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as file:
        file.writestr("data", json.dumps({"seed": 0}))
    with pytest.raises(ValueError, match=r"other.zip holds a policy of none of PPO, A2C, .*, got ''; if .*--algorithm"):
        policies.load(tmp_path / "other.zip", trust=True)


def test_numbered_actions_need_levels(tmp_path):
    env = gym.make("FlatQuad-v0")
    env = gym.wrappers.TransformAction(env, lambda _: env.action_space.sample(), gym.spaces.Discrete(6))
    DQN("MlpPolicy", env, buffer_size=10, device="cpu").save(tmp_path / "dqn.zip")
    with pytest.raises(ValueError, match=r"dqn.zip does not fit.*Discrete\(6\).*numbered by flatgym.envs.levels"):
        policies.load(tmp_path / "dqn.zip", trust=True)


def test_spaces_that_do_not_match_are_both_named(tmp_path):
    PPO("MlpPolicy", gym.make("Pendulum-v1"), n_steps=8, batch_size=8, device="cpu").save(tmp_path / "three.zip")
    with pytest.raises(
        ValueError, match=r"three.zip does not fit.*observation_space of shape \(3,\).*\(19,\) for feat"
    ):
        policies.load(tmp_path / "three.zip", trust=True)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere.zip"):
        policies.load(tmp_path / "nowhere.zip", trust=True)


def test_a_full_disk_leaves_the_older_file(file, models, monkeypatch):
    before = file.read_bytes()

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device", str(file))

    monkeypatch.setattr(zipfile.ZipFile, "writestr", full)
    monkeypatch.setattr(archive, "members", lambda _: {"data": b""})
    with pytest.raises(OSError, match=r"an older file is intact.*No space left.*policy\.zip") as error:
        policies.save(models["PPO"], file)
    assert error.value.errno == errno.ENOSPC
    assert file.read_bytes() == before
    assert [other.name for other in file.parent.iterdir()] == ["policy.zip"]


def test_the_algorithms_of_the_configurations_are_known():
    assert set(algorithms.ALGORITHMS) > set(CONFIGS)
    assert algorithms.algorithm("SAC") is stable_baselines3.SAC
