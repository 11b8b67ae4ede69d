"""VecNormalize: its statistics are found, matched to the frames they belong to, and missed where they are missing."""

import pickle
import shutil
import warnings

import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize

from agents import fly, policies
from agents.policies.adapters import load_policy
from agents.policies.normalization import PolicyWarning, beside, load_statistics, was_normalized
from agents.training.vec_env import make_vec_env

ON_POLICY = {"n_steps": 8, "batch_size": 8}
OFF_POLICY = {"buffer_size": 200, "learning_starts": 100}
KINDS = [(PPO, "features"), (PPO, "state"), (SAC, "features"), (SAC, "state"), (TD3, "features")]


def trained(kind=PPO, observation="features", wrap=VecNormalize):
    """Return a model after a moment of training, and its environments."""
    envs = wrap(make_vec_env("random-goal", 4, observation=observation, seed=3))
    arguments = ON_POLICY if kind is PPO else OFF_POLICY
    return kind("MlpPolicy", envs, device="cpu", seed=0, policy_kwargs={"net_arch": [8]}, **arguments).learn(64), envs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the zip of a PPO that was trained under VecNormalize, and its statistics elsewhere."""
    place = tmp_path_factory.mktemp("normalised")
    model, envs = trained()
    model.save(place / "ppo.zip")
    (place / "apart").mkdir()
    envs.save(str(place / "apart" / "statistics.pkl"))
    return place


@pytest.fixture
def home(folder, tmp_path):
    shutil.copy(folder / "ppo.zip", tmp_path)
    return tmp_path


def flown(policy, seed=7):
    return np.concatenate(fly(policy, "random-goal", 3, seed).actions)


def in_training(model, envs, seed=7):
    """Return the actions of the first steps under the wrappers of the training."""
    envs.training = False
    envs.venv.seed_exactly(seed)
    seen, found = envs.reset(), []
    for _ in range(5):
        found.append(model.predict(seen, deterministic=True)[0])
        seen = envs.step(found[-1])[0]
    return np.array(found)


@pytest.mark.parametrize(("kind", "observation"), KINDS)
def test_a_normalised_model_flies_as_in_its_training(tmp_path, kind, observation):
    model, envs = trained(kind, observation)
    model.save(tmp_path / "mine.zip")
    envs.save(str(tmp_path / "mine_vecnormalize.pkl"))
    with pytest.warns(PolicyWarning, match=r"observations are normalised with .*mine_vecnormalize\.pkl"):
        policy = load_policy(str(tmp_path / "mine.zip"), trust=True)
    actions = [one[:5] for one in fly(policy, "random-goal", 4, 7).actions]
    np.testing.assert_allclose(np.array(actions).swapaxes(0, 1), in_training(model, envs), atol=1e-6)
    assert not np.array_equal(flown(policy), flown(model))


@pytest.mark.parametrize(
    ("wrap", "size"),
    [(lambda envs: VecFrameStack(VecNormalize(envs), 3), 19), (lambda envs: VecNormalize(VecFrameStack(envs, 3)), 57)],
    ids=["each frame", "the stack"],
)
def test_statistics_belong_to_a_frame_or_to_the_stack(tmp_path, wrap, size):
    model, envs = trained(wrap=wrap)
    inner = model.get_vec_normalize_env()
    inner.save(str(tmp_path / "vecnormalize.pkl"))
    model.save(tmp_path / "stack.zip")
    assert inner.obs_rms.mean.shape == (size,)
    with pytest.warns(PolicyWarning, match="are normalised with"):
        policy = load_policy(str(tmp_path / "stack.zip"), trust=True)
    inner.training = False
    envs.unwrapped.seed_exactly(7)
    seen, expected = envs.reset(), []
    for _ in range(5):
        expected.append(model.predict(seen, deterministic=True)[0])
        seen = envs.step(expected[-1])[0]
    actions = [one[:5] for one in fly(policy, "random-goal", 4, 7).actions]
    np.testing.assert_allclose(np.array(actions).swapaxes(0, 1), expected, atol=1e-6)


@pytest.mark.parametrize(("kind", "observation"), KINDS)
def test_a_zip_shows_whether_it_was_trained_under_vec_normalize(kind, observation):
    assert was_normalized(trained(kind, observation)[0])
    assert was_normalized(trained(kind, observation, wrap=lambda envs: envs)[0]) is False


def test_only_the_reward_normalised_is_no_normalised_observation():
    assert was_normalized(trained(wrap=lambda envs: VecNormalize(envs, norm_obs=False))[0]) is False


def test_a_model_that_has_not_trained_shows_nothing():
    assert was_normalized(PPO("MlpPolicy", make_vec_env("hoop", 1), device="cpu", **ON_POLICY)) is None


def test_missing_statistics_are_warned_of(home):
    with pytest.warns(PolicyWarning, match=r"ppo\.zip seems to have been trained under VecNormalize.*--normalize FILE"):
        load_policy(str(home / "ppo.zip"), trust=True)


def test_a_zip_of_ours_remembers_that_it_was_normalised(tmp_path):
    policies.save(trained()[0], tmp_path / "ours.zip")
    with pytest.warns(PolicyWarning, match="seems to have been trained under VecNormalize"):
        load_policy(str(tmp_path / "ours.zip"), trust=True)
    policies.save(trained(wrap=lambda envs: envs)[0], tmp_path / "plain.zip")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_policy(str(tmp_path / "plain.zip"), trust=True)


NAMES = [
    "ppo_vecnormalize.pkl", "ppo_vec_normalize.pkl", "vecnormalize.pkl", "vec_normalize.pkl",
    "FlatQuad-v0/vecnormalize.pkl",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_usual_names_are_found(folder, home, name):
    (home / name).parent.mkdir(exist_ok=True)
    shutil.copy(folder / "apart" / "statistics.pkl", home / name)
    with pytest.warns(PolicyWarning, match=name):
        found = load_policy(str(home / "ppo.zip"), trust=True)
    given = load_policy(str(home / "ppo.zip"), trust=True, normalize=str(folder / "apart" / "statistics.pkl"))
    np.testing.assert_array_equal(flown(found), flown(given))


def test_checkpoints_are_matched_by_their_steps(tmp_path):
    for name in ("rl_model_vecnormalize_100_steps.pkl", "rl_model_vecnormalize_200_steps.pkl", "vecnormalize.pkl"):
        (tmp_path / name).touch()
    assert beside(tmp_path / "rl_model_200_steps.zip") == tmp_path / "rl_model_vecnormalize_200_steps.pkl"
    assert beside(tmp_path / "last.zip") == tmp_path / "vecnormalize.pkl"


def test_statistics_of_another_model_in_the_folder_are_not_used(folder, tmp_path):
    trained(wrap=lambda envs: envs)[0].save(tmp_path / "plain.zip")
    shutil.copy(folder / "apart" / "statistics.pkl", tmp_path / "vecnormalize.pkl")
    with pytest.warns(PolicyWarning, match=r"is not used: .*plain\.zip was trained without VecNormalize"):
        plain = load_policy(str(tmp_path / "plain.zip"), trust=True)
    assert type(plain) is PPO


class Trap:
    """An object that creates a file when unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_untrusted_statistics_are_not_read(home):
    (home / "trap.pkl").write_bytes(pickle.dumps(Trap(home / "sprung")))
    shutil.copy(home / "trap.pkl", home / "vecnormalize.pkl")
    pretrained = str(policies.archive.PRETRAINED / "hoop.zip")
    for arguments in ((str(home / "ppo.zip"),), (pretrained,)):
        with pytest.raises(ValueError, match=r"trap.pkl is not part of the package|ppo.zip is not part"):
            load_policy(*arguments, normalize=str(home / "trap.pkl"))
    assert not (home / "sprung").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "does not hold statistics of VecNormalize that can be read"),
        (b"no pickle", "does not hold statistics of VecNormalize that can be read"),
        (pickle.dumps({"mean": 0}), r"holds a dict, not the VecNormalize of a training"),
    ],
)
def test_a_file_of_something_else_is_named(tmp_path, content, words):
    (tmp_path / "other.pkl").write_bytes(content)
    with pytest.raises(ValueError, match=rf"other\.pkl {words}"):
        load_statistics(tmp_path / "other.pkl")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no statistics of VecNormalize at .*nowhere\.pkl"):
        load_statistics(tmp_path / "nowhere.pkl")


def test_statistics_of_other_observations_are_refused(home, tmp_path):
    trained(observation="state")[1].save(str(tmp_path / "state.pkl"))
    with pytest.raises(ValueError, match=r"have shape \(5,\), the policy's observations \(19,\): they are of another"):
        load_policy(str(home / "ppo.zip"), trust=True, normalize=str(tmp_path / "state.pkl"))


@pytest.mark.parametrize("observation", ["features", "state"])
def test_a_function_is_normalised_too(tmp_path, monkeypatch, observation):
    envs = trained(observation=observation)[1]
    envs.save(str(tmp_path / "statistics.pkl"))
    (tmp_path / "my_flatquad_function.py").write_text("def act(seen):\n    return seen[:, 2:4] / 10\n")
    monkeypatch.chdir(tmp_path)
    policy = load_policy("my_flatquad_function:act", True, normalize="statistics.pkl")
    envs.training = False
    plain = make_vec_env("random-goal", 3, observation=observation)
    plain.seed_exactly(7)
    seen = plain.reset()
    first = [one[0] for one in fly(policy, "random-goal", 3, 7).actions]
    np.testing.assert_allclose(first, np.clip(envs.normalize_obs(seen)[:, 2:4] / 10, -1, 1), atol=1e-6)
