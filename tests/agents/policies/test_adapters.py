"""Adapters: every callable policy works, and every failure names its cause."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation.rollouts import fly
from agents.policies import archive
from agents.policies.adapters import Adapted, PolicyFailed, load_policy
from flatgym import SCENARIOS

PD = CascadedPD(SCENARIOS["hoop"].quadrotor)
SEEN = np.zeros((3, 19), dtype=np.float32)


class Full:
    """The full signature of Stable-Baselines3."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):  # noqa: ARG002
        return PD.predict(observation)[0], (0 if state is None else state + 1)


class Bare:
    """Takes only observations and returns only actions."""

    def predict(self, observation):
        return PD.predict(observation)[0]


def function(observation):
    return PD.predict(observation)[0].tolist()


def single(observation):
    """Accepts one vehicle only."""
    assert observation.shape == (19,)
    return PD.predict(observation)[0]


@pytest.mark.parametrize("policy", [Full, Full(), Bare, function, single])
@pytest.mark.parametrize("flights", [1, 3])
def test_adapted_policies_act_like_the_controller(policy, flights):
    flown, expected = fly(Adapted(policy), "random-goal", flights, 7), fly(PD, "random-goal", flights, 7)
    assert flown.outcomes == expected.outcomes
    assert flown.steps.tolist() == expected.steps.tolist()


def test_the_state_is_passed_back():
    policy, state = Adapted(Full), None
    for wanted in (0, 1, 2):
        _, state = policy.predict(SEEN, state=state)
        assert state == wanted


@dataclass
class Returns:
    answer: object

    def predict(self, observation):  # noqa: ARG002
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (ZeroDivisionError("by wind"), "mine failed: ZeroDivisionError: by wind"),
        (np.zeros((3, 5)), r"mine returned actions of shape \(3, 5\) for 3 observations; wanted \(3, 2\)"),
        ("left", "mine returned 'left', which is not an array of actions"),
        (None, "mine returned None, which is not an array of actions"),
        (np.zeros((3, 2), dtype=bool), "mine returned .*, which is not an array of actions"),
        ([["0.1", "0.2"]] * 3, "mine returned .*, which is not an array of actions"),
        (np.zeros((3, 2), dtype=complex), "mine returned .*, which is not an array of actions"),
        ({"action": np.zeros((3, 2))}, "mine returned {'action': .*, which is not an array of actions"),
        ([[0, 0], [0], [0]], "mine returned .*, which is not an array of actions"),
        (np.array([[0, 0], [np.nan, 0], [0, 0]]), r"the action \[nan, 0.0\] for observation 1 of 3; both .* finite"),
        (torch.tensor([[0, 0], [0, 0], [0, np.inf]]), r"the action \[0.0, inf\] for observation 2 of 3"),
        (np.zeros(2), r"mine returned one action, of shape \(2,\), for 3 observations; wanted \(3, 2\), one for each"),
        ([0.5, 0.0], r"mine returned one action, of shape \(2,\), for 3 observations"),
        (torch.zeros(2), r"mine returned one action, of shape \(2,\), for 3 observations"),
        ((0.5, 0.0), r"mine returned one action, of shape \(2,\), for 3 observations"),
        ((np.zeros(2), None), r"mine returned one action, of shape \(2,\), for 3 observations"),
    ],
)
def test_errors_name_the_first_cause(answer, words):
    with pytest.raises(PolicyFailed, match=words):
        Adapted(Returns(answer), "mine").predict(SEEN)


@pytest.mark.parametrize("shape", [(2,), (1, 2)])
@pytest.mark.parametrize("kind", [np.array, torch.tensor, list, tuple])
def test_one_observation_may_have_its_action_without_a_batch_axis(shape, kind):
    action = np.reshape([0.5, -0.25], shape).tolist()
    found = Adapted(Returns(kind(action)), "mine").predict(SEEN[:1])[0]
    np.testing.assert_array_equal(found, [[0.5, -0.25]])


@pytest.mark.parametrize(
    "answer",
    [
        torch.ones(3, 2, requires_grad=True),
        torch.ones(3, 2, dtype=torch.float16),
        [torch.ones(2, requires_grad=True)] * 3,
        np.ones((3, 2), dtype=int),
        [[1, 1]] * 3,
        (torch.ones(3, 2, requires_grad=True), None),
    ],
    ids=["gradient", "half", "list of tensors", "integers", "list", "with state"],
)
def test_answers_that_mean_actions_are_converted(answer):
    found = Adapted(Returns(answer), "mine").predict(SEEN)[0]
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, np.ones((3, 2)))


def test_a_function_of_tensors_is_told_what_it_receives():
    layer = torch.nn.Linear(19, 2)
    with pytest.raises(PolicyFailed, match=r"mine failed: TypeError.*observations are NumPy arrays: torch\.as_tensor"):
        Adapted(layer.forward, "mine").predict(SEEN)
    assert Adapted(lambda seen: layer(torch.as_tensor(seen)), "mine").predict(SEEN)[0].shape == (3, 2)


def test_tensors_of_a_raw_policy_are_flown():
    class Raw:
        def predict(self, observation, **_):
            return torch.tensor(PD.predict(observation)[0], requires_grad=True), None

    assert fly(Raw(), "hoop").steps == fly(PD, "hoop").steps


def test_nan_actions_are_refused_by_the_environment():
    class Raw:
        def predict(self, observation, **_):
            return np.full((len(observation), 2), np.nan), None

    with pytest.raises(ValueError, match="finite"):
        fly(Raw(), "hoop", 2)


def test_objects_that_cannot_act_are_refused():
    with pytest.raises(PolicyFailed, match=r"mine is not a policy: it has no predict"):
        Adapted(3, "mine")

    class Broken:
        def __init__(self):
            raise RuntimeError("no licence")

    with pytest.raises(PolicyFailed, match="no licence"):
        Adapted(Broken, "mine")


def test_policies_are_loaded_from_module_file_and_zip(tmp_path, monkeypatch):
    source = "def pilot(observation):\n    return observation[..., :2] * 0\n"
    (tmp_path / "my_flatquad_pilots.py").write_text(source)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("my_flatquad_pilots:pilot", f"{tmp_path / 'my_flatquad_pilots.py'}:pilot"):
        assert np.array_equal(load_policy(name).predict(SEEN)[0], np.zeros((3, 2)))
    assert load_policy(str(archive.PRETRAINED / "hoop.zip")).predict(SEEN)[0].shape == (3, 2)
    with pytest.raises(ValueError, match="has no 'pilt'; did you mean 'pilot'"):
        load_policy("my_flatquad_pilots:pilt")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("policy", "neither a file of a policy .* nor of the form module:object"),
        ("no_such_module:policy", "'no_such_module' cannot be imported: ModuleNotFoundError"),
        ("missing.zip", "missing.zip is not part of the package"),
    ],
)
def test_missing_policies_are_named(name, words):
    with pytest.raises(ValueError, match=words):
        load_policy(name)


def test_a_failing_import_is_reported(tmp_path):
    (tmp_path / "broken.py").write_text("raise SystemError('half installed')\n")
    with pytest.raises(ValueError, match="SystemError: half installed"):
        load_policy(f"{tmp_path / 'broken.py'}:policy")
