"""Expert data: read from recorded demonstrations, and mirrored."""

from dataclasses import replace

import numpy as np
import pytest

from agents import demonstrations
from agents.imitation.dataset import concatenate, load_expert_data, with_mirror_images
from agents.imitation.trajectories import labels_along
from flatgym import SCENARIOS
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.task.observation import observe
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import Scene


def test_demonstrations_are_read_and_those_of_another_scenario_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    planned = demonstrations.plan("horizontal-3", 2, jobs=1)
    dataset = demonstrations.record("horizontal-3", planned)
    found = load_expert_data(dataset, "horizontal-3")
    assert found.observations.shape == (sum(one.steps for one in planned), 19)
    assert (found.labels, found.env_steps) == (len(found.actions), 0)
    np.testing.assert_array_equal(found.actions[: planned[0].steps], planned[0].flight.actions)
    with pytest.raises(ValueError, match="horizontal-6"):
        load_expert_data(dataset, "horizontal-6")


def test_counts_are_added_and_nothing_has_no_rows(data):
    both = concatenate([data._replace(env_steps=3), data])
    assert (both.labels, both.env_steps) == (2 * data.labels, 3)
    assert concatenate([]).observations.shape == (0, 19)


@pytest.mark.parametrize("name", ["climb", "slalom"])
def test_mirror_images_are_flights_of_the_mirrored_scenario(name):
    scenario, actions = SCENARIOS[name], reference(name).actions
    data = labels_along(scenario, ghost_states(name), actions)
    reflected = replace(
        scenario,
        start=(-scenario.start[0], scenario.start[1]),
        goal=(-scenario.goal[0], scenario.goal[1]),
        hoops=tuple(replace(hoop, x=-hoop.x, angle=np.pi - hoop.angle) for hoop in scenario.hoops),
    )
    twice, turned = with_mirror_images(data), actions * np.array([1, -1], dtype=np.float32)
    flown = fly_actions(reflected, turned)
    seen = np.concatenate([observe(Scene.of([reflected]), state) for state in flown[:-1]])
    np.testing.assert_allclose(twice.observations[len(actions) :], seen, atol=2e-5)
    np.testing.assert_array_equal(twice.actions[len(actions) :], turned)
