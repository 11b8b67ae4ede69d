"""Guidance features: mirror symmetry, independence of time, and zero predicted miss on course."""

import numpy as np
import pytest
import torch

from agents import policies
from agents.imitation.cloning import CloneConfig, untrained_policy
from agents.imitation.dataset import ExpertData, with_mirror_images
from agents.policies import compact
from agents.policies.guidance import HOOPS, MAX_TIME_TO_GO, PER_HOOP, TIMELESS, Guidance, to_gaps, unsquashed
from flatgym import SCENARIOS, Quadrotor
from flatgym.envs.spaces import observation_space
from flatgym.scenarios.reference import ghost_states
from flatgym.scenarios.scenario import Hoop, Scenario
from flatgym.task.observation import HOOPS_SEEN, LENGTH_UNIT, observe, squash
from flatgym.task.scene import EpisodeState, Scene

AHEAD, ASIDE, COASTING, THRUSTING = range(4)
CLOSING, DRIFT, FORWARDS, SIDEWAYS, TIME = range(4, 9)
SIGNS = [1, -1, -1, -1, 1, -1, 1, -1, 1, -1, -1, -1]
"""Signs of the features of a hoop in the mirror: quantities across the axis change sign."""


@pytest.fixture(scope="module")
def guidance():
    return Guidance(observation_space("features"), 6.0)


def seen(scenario, states, passed=0):
    none = np.zeros(len(states), dtype=np.int64)
    return observe(
        Scene.of([scenario] * len(states)), EpisodeState(np.asarray(states, dtype=float), none, none + passed, none)
    )


def gaps(observations):
    """Return the features of the observed hoops, shape (n, HOOPS_SEEN, PER_HOOP)."""
    observed = torch.from_numpy(observations)
    return to_gaps(
        observed[:, HOOPS].unflatten(1, (HOOPS_SEEN, -1)),
        unsquashed(observed[:, None, 2:4], 4.0),
        observed[:, None, 4:6],
    ).numpy()


def test_a_mirror_changes_only_signs(guidance):
    name = "slalom"
    observations = seen(SCENARIOS[name], ghost_states(name))
    both = with_mirror_images(ExpertData(observations, np.zeros((len(observations), 2), np.float32))).observations
    before, after = guidance(torch.from_numpy(both)).numpy().reshape(2, len(observations), -1)
    np.testing.assert_allclose(np.abs(after), np.abs(before), atol=1e-5)
    hoops = slice(TIMELESS, TIMELESS + HOOPS_SEEN * PER_HOOP)
    np.testing.assert_allclose(after[:, hoops], before[:, hoops] * (SIGNS * HOOPS_SEEN), atol=1e-5)


def test_features_are_finite_as_many_as_declared_and_independent_of_time(guidance):
    edges = torch.tensor(np.stack([observation_space("features").low, observation_space("features").high]))
    features = guidance(edges)
    assert features.shape == (2, guidance.features_dim)
    assert torch.isfinite(features).all()
    later = edges.clone()
    later[:, -1] = 0.3
    torch.testing.assert_close(guidance(later), features, rtol=0, atol=0)


def test_without_a_hoop_its_features_are_zero(guidance):
    name = "hoop"
    hoops = slice(TIMELESS, TIMELESS + HOOPS_SEEN * PER_HOOP)
    before, after = (
        guidance(torch.from_numpy(seen(SCENARIOS[name], ghost_states(name), passed)))[:, hoops] for passed in (0, 1)
    )
    assert (before[:, :PER_HOOP] != 0).any(dim=0).all()
    assert not before[:, PER_HOOP:].any()
    assert not after.any()


@pytest.mark.parametrize("angle", [-2.0, 0.3, 1.4])
def test_a_gap_is_expressed_in_its_own_frame(angle):
    hoop, place = Hoop(3.0, -1.0, 0.8, angle), np.array([1.2, 0.4])
    scenario = Scenario("turned", (0, 0), (6, 0), (hoop,))
    velocity = 4.0 * hoop.direction + 0.7 * hoop.across
    found = gaps(seen(scenario, [[*place, *velocity, angle]]))[0, 0]
    way = hoop.centre - place
    expected = {
        AHEAD: squash(torch.tensor(way @ hoop.direction), 0.5),
        ASIDE: squash(torch.tensor(way @ hoop.across), 0.25),
        CLOSING: 4.0 / 8.0,
        DRIFT: 0.7 / 2.7,
        TIME: np.clip(way @ hoop.direction / 4.0, 0, MAX_TIME_TO_GO),
        FORWARDS: np.array([np.sin(angle), np.cos(angle)]) @ hoop.direction,
    }
    for which, value in expected.items():
        assert found[which] == pytest.approx(float(value), abs=2e-5), which


def test_coasting_through_the_centre_has_no_predicted_miss(generator):
    hoop = Hoop(2.0, 1.0, 0.6, 0.5)
    scenario = Scenario("ahead", (0, 0), (4, 2), (hoop,))
    for time in generator.uniform(0.2, 1.5, 5):
        velocity = 3.0 * hoop.direction + generator.uniform(-1, 1) * hoop.across
        states = [[*(hoop.centre - time * velocity), *velocity, 0.0]]
        found = gaps(seen(scenario, states))[0, 0]
        assert found[COASTING] == pytest.approx(0.0, abs=1e-3)
        assert found[TIME] == pytest.approx(time, abs=1e-3)
        assert found[ASIDE] != pytest.approx(0.0, abs=1e-3)


def test_thrusting_through_the_centre_has_no_predicted_miss():
    """Upright before a level gap, thrust does not change the time to go, and the predicted miss is exact."""
    hoop, quadrotor, time = Hoop(3.0, 1.0, 0.6, 0.0), Quadrotor(), 0.4
    at_the_gap = np.array([*hoop.centre, 5.0, 2.0, 0.0])
    state = quadrotor.step(at_the_gap, np.array([quadrotor.thrust_max, 0.0]), -time)
    found = gaps(seen(Scenario("level", (0, 0), (6, 0), (hoop,)), state[None]))[0, 0]
    assert found[TIME] == pytest.approx(time, abs=1e-4)
    assert found[THRUSTING] == pytest.approx(0.0, abs=1e-3)
    assert abs(found[COASTING]) > 0.5


def test_lengths_are_decoded_in_metres_and_infinite_ones_clipped():
    lengths = torch.tensor([-40.0, -0.3, 0.0, 2.0, 30.0])
    torch.testing.assert_close(unsquashed(squash(lengths, LENGTH_UNIT)), lengths, rtol=1e-4, atol=1e-5)
    assert unsquashed(torch.tensor(1.0)) == 50.0


def test_the_feature_extractor_is_saved_with_the_policy(tmp_path):
    model = compact.rounded(untrained_policy(CloneConfig(scenario="hoop", width=16, depth=1, guidance=True)))
    loaded = policies.load(policies.save(model, tmp_path / "guided.zip"), trust=True)
    observations = seen(SCENARIOS["hoop"], ghost_states("hoop"))
    np.testing.assert_array_equal(
        loaded.predict(observations, deterministic=True)[0], model.predict(observations, deterministic=True)[0]
    )
    assert isinstance(loaded.policy.features_extractor, Guidance)
