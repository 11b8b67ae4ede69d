"""Checkpoints: interrupted trainings resume bit for bit, and damaged files are refused."""

import json
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import torch

from agents.evaluation.validation import VALIDATION_SEED
from agents.training import checkpoints
from agents.training.checkpoints import checkpoint_file, segment_seed
from agents.training.configs import CONFIGS, config_of
from agents.training.models import build
from agents.training.progress import curve_file, read_curve
from agents.training.train import train
from flatgym import SCENARIOS
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.scenarios.scenario import Tolerance

COMMON = {"num_envs": 8, "width": 8, "max_seconds": 1e5, "n_eval_episodes": 4}
PPO = {"env_steps": 1024, "n_steps": 16, "batch_size": 128, "n_epochs": 2, "checkpoint_every": 3, "eval_every": 2}
OFF_POLICY = {
    "env_steps": 320,
    "learning_starts": 64,
    "batch_size": 16,
    "gradient_steps": 1,
    "buffer_size": 200,
    "checkpoint_every": 12,
    "eval_every": 5,
}
EASY = replace(SCENARIOS["horizontal-3"], goal=(0.0, -0.6), tolerance=Tolerance(0.5, 4.0, 1.0), time_limit=0.6)
"""A scenario that random flights solve now and then, so that there is a flight to imitate."""


class Killed(BaseException):
    """An exception that no handler catches."""


def small(algorithm, folder, scenario="horizontal-3", **changes):
    own = PPO if algorithm == "PPO" else OFF_POLICY
    return config_of(algorithm, scenario=scenario, folder=str(folder), **COMMON | own | changes)


def killed(config, at, resume=False):
    """Train until the validation at `at` environment steps, and raise there."""

    def on_validation(point):
        if point["env_steps"] >= at:
            raise Killed

    with pytest.raises(Killed):
        train(config, resume=resume, on_validation=on_validation)


def flown(curve):
    """Return a curve without its wall time."""
    return [{name: value for name, value in point.items() if name != "wall_time_s"} for point in curve]


@pytest.mark.parametrize(
    ("algorithm", "scenario"), [(name, "horizontal-3") for name in CONFIGS] + [("PPO", "random-hoops")]
)
def test_an_interrupted_training_ends_bit_for_bit_like_an_uninterrupted_one(tmp_path, algorithm, scenario):
    assert interrupted_like_uninterrupted(tmp_path, algorithm, scenario)["flight"] is None


def test_the_flight_to_imitate_survives_an_interruption(tmp_path):
    progress = interrupted_like_uninterrupted(tmp_path, "PPO", EASY.to_json(), tolerance=1.0)
    assert len(progress["flight"][0]) <= progress["curve"][0]["steps"]


def interrupted_like_uninterrupted(tmp_path, algorithm, scenario, **changes):
    """Check that both trainings end alike, and return the progress in their checkpoints."""
    whole = train(small(algorithm, tmp_path / "whole", scenario, **changes))
    config = small(algorithm, tmp_path / "killed", scenario, **changes)
    killed(config, 0.2 * config.env_steps)  # before the first checkpoint
    killed(config, 0.6 * config.env_steps, resume=True)
    killed(config, 0.9 * config.env_steps, resume=True)
    resumed = train(config, resume=True)
    assert resumed.model.read_bytes() == whole.model.read_bytes()
    assert flown(resumed.curve) == flown(whole.curve) == flown(read_curve(config))
    assert resumed.env_steps == whole.env_steps
    assert resumed.wall_time_s > resumed.curve[0]["wall_time_s"]
    last = [torch.load(tmp_path / run / "checkpoint.pt", weights_only=True) for run in ("whole", "killed")]
    assert str(last[0]["parameters"]) == str(last[1]["parameters"])
    assert str(last[0]["progress"]["flight"]) == str(last[1]["progress"]["flight"])
    return last[0]["progress"]


@pytest.mark.parametrize("algorithm", [name for name in CONFIGS if name != "PPO"])
def test_no_return_runs_into_the_episodes_of_the_next_segment(tmp_path, algorithm):
    model = build(small(algorithm, tmp_path)).learn(160)
    buffer, dones = model.replay_buffer, model.replay_buffer.dones.copy()
    newest = np.array([buffer.pos - 1])
    checkpoints.end_episodes(model)
    model._last_obs = None
    model.learn(40, reset_num_timesteps=False)  # as much as the buffer still holds
    assert (buffer.dones[newest] + buffer.timeouts[newest] >= 1).all()
    np.testing.assert_array_equal(buffer.dones[: newest[0] + 1], dones[: newest[0] + 1])
    samples = buffer._get_samples(newest.repeat(50))
    np.testing.assert_allclose(samples.discounts, model.gamma)
    assert (buffer._get_samples((newest - 1).repeat(50)).discounts > model.gamma**2 - 1e-6).all()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    config = small("PPO", tmp_path_factory.mktemp("finished"))
    return config, train(config)


@pytest.fixture
def copy(finished, tmp_path):
    """The configuration of a finished training with a copy of its checkpoint."""
    config = replace(finished[0], folder=str(tmp_path))
    checkpoint_file(config).write_bytes(checkpoint_file(finished[0]).read_bytes())
    return config


def test_a_finished_training_does_not_continue(finished, copy):
    again = train(copy, resume=True)
    assert again.env_steps == finished[1].env_steps
    assert flown(again.curve) == flown(finished[1].curve)
    assert again.model.read_bytes() == finished[1].model.read_bytes()


def test_an_earlier_training_is_replaced_only_when_asked(copy):
    before = checkpoint_file(copy).read_bytes()
    with pytest.raises(
        ValueError, match=r"holds checkpoint.pt of an earlier training: .*--resume.*--overwrite.*--folder"
    ):
        train(copy)
    assert checkpoint_file(copy).read_bytes() == before
    seen = []
    train(copy, overwrite=True, on_validation=seen.append)
    assert seen[0]["env_steps"] == 256
    checkpoint_file(copy).unlink()
    with pytest.raises(ValueError, match=r"holds model.zip of an earlier training"):
        train(copy)


def test_a_finished_training_is_prolonged_by_more_steps(finished, copy):
    longer = train(replace(copy, env_steps=1536), resume=True)
    assert longer.env_steps == 1536
    before = flown(finished[1].curve)[:-1]  # the last point is the final validation
    assert flown(longer.curve)[: len(before)] == before
    assert longer.curve[-1]["env_steps"] == 1536
    shorter = train(replace(copy, env_steps=512), resume=True)
    assert shorter.env_steps == 1536


def test_segment_seeds_differ_from_each_other_and_from_validation_and_scores(finished):
    config = finished[0]
    seeds = {segment_seed(replace(config, seed=seed), segment) for seed in range(10) for segment in range(10)}
    assert len(seeds) == 100
    assert max(seeds) + 100_000 < VALIDATION_SEED < VALIDATION_SEED + config.n_eval_episodes < EVALUATION_SEED


def test_a_resumed_configuration_may_differ_in_length_folder_and_logging_only(copy):
    assert (
        checkpoints.restore(replace(copy, max_seconds=7.0, tensorboard="runs", env_steps=4096), build(copy)).segment
        == 3
    )
    with pytest.raises(
        ValueError, match=r"checkpoint.pt was written with seed = 0, not 1, width = 8, not 16; .*policy='.*model.zip'"
    ):
        train(replace(copy, seed=1, width=16), resume=True)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.999])
def test_a_truncated_checkpoint_is_named_with_a_remedy(copy, share):
    path = checkpoint_file(copy)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(ValueError, match=r"checkpoint.pt cannot be read as a checkpoint: .*or delete it"):
        train(copy, resume=True)
    assert path.exists()


def test_a_corrupt_byte_is_detected(copy):
    path = checkpoint_file(copy)
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as file:
        longest = max((file.read(name) for name in file.namelist()), key=len)
    content[content.index(longest) + len(longest) // 3] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(ValueError, match="cannot be read as a checkpoint"):
        train(copy, resume=True)


@pytest.mark.parametrize(
    "change", [{"schema": 2}, {"progress": {"segments": 1}}, {"parameters": {}}, {"config": 3}, {"updates": None}]
)
def test_checkpoints_with_other_content_are_refused(copy, change):
    path = checkpoint_file(copy)
    content = torch.load(path, weights_only=True) | change
    torch.save({name: value for name, value in content.items() if value is not None}, path)
    with pytest.raises(ValueError, match="cannot be read as a checkpoint"):
        train(copy, resume=True)


class Trap:
    """An object that creates a file when unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.mark.parametrize("write", [torch.save, lambda content, path: path.write_bytes(pickle.dumps(content))])
def test_reading_a_checkpoint_executes_nothing(copy, tmp_path, write):
    write({"schema": 1, "config": Trap(tmp_path / "sprung")}, checkpoint_file(copy))
    with pytest.raises(ValueError, match="cannot be read as a checkpoint"):
        train(copy, resume=True)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("enforce fail: file write")])
def test_a_full_disk_leaves_the_previous_checkpoint(copy, monkeypatch, error):
    path = checkpoint_file(copy)
    before, model = path.read_bytes(), build(copy)
    progress = checkpoints.restore(copy, model)

    def full(_, temporary):
        temporary.write_bytes(b"half")
        raise error

    monkeypatch.setattr(torch, "save", full)
    with pytest.raises(OSError, match=r"checkpoint.pt could not be written; the previous checkpoint is intact"):
        checkpoints.write(copy, model, progress)
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == ["checkpoint.pt"]


def test_the_curve_is_truncated_to_the_checkpoint(copy):
    curve_file(copy).write_text(json.dumps({"env_steps": 10**9}) + "\n{")
    train(copy, resume=True)
    assert [point["env_steps"] for point in read_curve(copy)] == [256, 512, 768, 1024, 1024]
