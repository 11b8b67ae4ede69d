"""Best-known solutions of the named scenarios: they replay, and the numbers are the published ones."""

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from experiments.files import published
from flatgym import DISTRIBUTIONS, OUTCOMES, SCENARIOS
from flatgym.scenarios import reference as module
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star, ghost_states, reference
from flatgym.task.rollout import fly_actions
from optimal import fewest_steps

NAMES = list(SCENARIOS)
DRAWN = [("random-goal", 1000, 0.9, 3), ("random-hoops", 300, 0.9, 3), ("random-track", 100, 0.6, 23)]
"""Distribution, known K*, least share of proven ones, and largest difference to the lower bound [steps]."""
ONE_HOOP = EVALUATION_SEED + 13


@pytest.mark.parametrize("name", NAMES)
def test_solutions_replay_to_the_goal_in_k_star_steps(name):
    known = reference(name)
    flown = fly_actions(SCENARIOS[name], known.actions)
    assert OUTCOMES[flown[-1].outcome[0]] == "goal"
    assert len(flown) - 1 == len(known.actions) == known.k_star
    assert np.array_equal([episode.state[0] for episode in flown], ghost_states(name))
    assert round(flown[-1].state[0, 4] / (2 * np.pi)) == known.winding


@pytest.mark.parametrize("name", NAMES)
def test_solutions_reach_the_goal_in_the_environment(name):
    known = reference(name)
    env = gym.make("FlatQuad-v0", scenario=name)
    env.reset(seed=0)
    for action in known.actions:
        *_, terminated, truncated, info = env.step(action)
    assert terminated
    assert not truncated
    assert (info["outcome"], info["steps"]) == ("goal", known.k_star)
    assert np.allclose(ghost_states(name)[-1], info["state"], atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_numbers_are_the_published_ones(name):
    known, sections = reference(name), published("solvers.json")["sections"]
    (steps,) = (row for row in sections["steps"]["rows"] if row["scenario"] == name)
    (bounds,) = (row for row in sections["bounds"]["rows"] if row["scenario"] == name)
    assert (known.k_star, known.k_lower_bound, known.proven) == (steps["k_star"], steps["lower_bound"], steps["proven"])
    assert (known.time, known.time_lower_bound) == (bounds["upper_bound_s"], bounds["lower_bound_s"])
    assert known.k_lower_bound <= known.k_star
    assert known.proven == (known.k_lower_bound == known.k_star)
    assert known.time_lower_bound <= known.time


def test_exactly_the_contents_of_the_named_scenarios_have_solutions():
    assert all(reference(scenario).scenario == name for name, scenario in SCENARIOS.items())
    assert reference(replace(SCENARIOS["hoop"], dt=0.01)) is None
    assert reference(replace(SCENARIOS["hoop"], name="mine")) is reference("hoop")
    assert reference(replace(SCENARIOS["diagonal"], name="hoop")) is reference("diagonal")
    assert all(reference(distribution) is None for distribution in DISTRIBUTIONS)
    with pytest.raises(ValueError, match="did you mean 'hoop'"):
        reference("hop")


def test_values_cannot_be_changed():
    for array in (reference("hoop").actions, ghost_states("hoop")):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_gap_is_measured_against_k_star():
    assert reference("hoop").gap(77) == pytest.approx(0.1)
    assert reference("hoop").gap(70) == 0


def test_a_ghost_is_from_start_to_goal():
    states = ghost_states("loop")
    assert states.shape == (137, 5)
    assert np.array_equal(states[0], SCENARIOS["loop"].start_state)


def test_a_ghost_without_a_solution_names_the_alternative():
    with pytest.raises(ValueError, match=r"for 'hoop'.*shape \(K\+1, 5\).*fewest_steps"):
        ghost_states(replace(SCENARIOS["hoop"], dt=0.01))


def test_a_file_of_another_schema_is_rejected(tmp_path, monkeypatch):
    (tmp_path / module.FILE).write_text(json.dumps({"schema": 0, "references": []}))
    monkeypatch.setattr(module, "files", lambda _: tmp_path)
    with pytest.raises(ValueError, match="has schema 0, this version reads 2"):
        module._data.__wrapped__()


@pytest.mark.parametrize(("name", "number", "proven", "gap"), DRAWN)
def test_k_star_of_evaluation_episodes_is_known(name, number, proven, gap):
    known = drawn_k_star(name, EVALUATION_SEED + np.arange(number))
    assert np.all(known.k_lower_bound <= known.k_star)
    assert np.all(known.k_star <= DISTRIBUTIONS[name].max_steps)
    assert np.array_equal(known.proven, known.k_lower_bound == known.k_star)
    assert known.proven.mean() >= proven
    assert np.all(known.k_star - known.k_lower_bound <= gap)


@pytest.mark.parametrize(
    ("name", "seed"),
    [("random-goal", EVALUATION_SEED + 41), ("random-goal", EVALUATION_SEED + 998), ("random-hoops", ONE_HOOP)],
)
def test_k_star_of_sampled_scenarios_is_reproduced(name, seed):
    found = fewest_steps(DISTRIBUTIONS[name].scenario(seed), time_budget=0)
    known = drawn_k_star(name, [seed])
    assert known.k_star.tolist() == [found.steps]
    assert known.k_lower_bound >= found.lower_bound


def test_k_star_of_other_samples_is_unknown():
    ends = EVALUATION_SEED + np.array([-1, 0, 999, 1000])
    assert np.isnan(drawn_k_star("random-goal", ends).k_star).tolist() == [True, False, False, True]
    assert drawn_k_star("random-goal", ends).proven[[0, 3]].tolist() == [False, False]
    coarse = replace(DISTRIBUTIONS["random-goal"], dt=0.04)
    for other in (coarse, SCENARIOS["hoop"]):
        known = drawn_k_star(other, ends)
        assert np.isnan(known).all()
        assert not known.proven.any()


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_k_star_is_looked_up_by_seed_in_any_order(name, generator):
    seeds = EVALUATION_SEED + generator.integers(-20, 400, 100)
    known = drawn_k_star(name, seeds)
    for i in (0, 50, 99):
        np.testing.assert_array_equal(np.transpose(known)[i], np.ravel(drawn_k_star(name, seeds[i : i + 1])))
