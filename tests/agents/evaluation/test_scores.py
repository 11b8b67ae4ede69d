"""Scores: gaps to K*, evaluation seeds, and the error for episodes faster than K*."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation import optima as module
from agents.evaluation.bootstrap import iqm, summary
from agents.evaluation.rollouts import fly
from agents.evaluation.scores import COLUMNS, FasterThanOptimal, episode_rows, evaluate, score_row
from flatgym import DISTRIBUTIONS, SCENARIOS, Disturbances
from flatgym.scenarios.catalogue import label
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star, reference
from optimal import fewest_steps

HOVER = np.array([(9.81 - 10.5) / 9.5, 0.0])
DROP = np.array([-1.0, 0.0])
GOALS = replace(DISTRIBUTIONS["random-goal"], name="near", half_width=0.6, time_limit=1.0)


class OpenLoop:
    """Replays actions in order and holds the last one; (K, 2) for all vehicles, (n, K, 2) for each its own."""

    def __init__(self, actions):
        self.actions = np.asarray(actions)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        k = np.where(episode_start, 0, 0 if state is None else state)
        tapes = np.broadcast_to(self.actions, (len(observation), *self.actions.shape[-2:]))
        return tapes[np.arange(len(tapes)), np.minimum(k, tapes.shape[1] - 1)], k + 1


class Hasty:
    """Flies most goals, and turns away from those that lie on the left."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):  # noqa: ARG002
        actions = CascadedPD().predict(observation)[0]
        actions[observation[:, 0] < -0.8] = DROP
        return actions, state


@pytest.fixture(scope="module")
def optimum():
    return fewest_steps("horizontal-3", windings=(0,), time_budget=0)


@pytest.fixture(scope="module")
def near():
    """K* of the first sampled goals of GOALS."""
    return [fewest_steps(GOALS.scenario(i), time_budget=0) for i in range(3)]


@pytest.fixture
def no_solver(monkeypatch):
    """Make every computation of K* fail."""

    def refuse(*_, **__):
        raise AssertionError("K* was computed although it is known")

    monkeypatch.setattr(module, "fewest_steps_many", refuse)


def padded(flights):
    """Return the actions of flights, padded with the last one, shape (n, K, 2)."""
    most = max(len(flight.actions) for flight in flights)
    return np.array([np.pad(f.actions, ((0, most - len(f.actions)), (0, 0)), mode="edge") for f in flights])


def test_the_optimal_flight_scores_zero_gap(optimum):
    scores = evaluate(
        OpenLoop(optimum.actions), "horizontal-3", episodes=3, optimum=optimum, agent="replay", command="test"
    )
    assert list(scores.columns) == list(COLUMNS)
    row = scores.iloc[0]
    assert (row.steps, row.k_star, row.gap, row.success_rate) == (optimum.steps, optimum.steps, 0.0, 1.0)
    assert (row.agent, row.command, row.outcomes) == ("replay", "test", {"goal": 3})
    assert (row.seed, row.proven) == (EVALUATION_SEED, False)
    assert set(row.versions) >= {"python", "flatgym", "torch"}


@pytest.mark.parametrize("name", ["loop", "ground-6"])
def test_a_named_scenario_needs_no_solver(name, no_solver):  # noqa: ARG001
    known = reference(name)
    row = evaluate(OpenLoop(known.actions), name, episodes=2).iloc[0]
    assert (row.scenario, row.steps, row.k_star, row.gap) == (name, known.k_star, known.k_star, 0)
    assert (row.proven, row.success_rate) == (known.proven, 1)


def test_a_failing_policy_has_no_gap(optimum):
    row = evaluate(OpenLoop([[1.0, 0.0]]), "horizontal-3", episodes=2, optimum=optimum).iloc[0]
    assert row.success_rate == 0
    assert np.isnan(row.steps)
    assert np.isnan(row.gap)
    assert row.k_star == optimum.steps
    assert row.outcomes == {"out-of-bounds": 2}


@pytest.mark.parametrize(("name", "count"), [("random-goal", 300), ("random-hoops", 300), ("random-track", 100)])
def test_a_distribution_is_scored_on_the_evaluation_seeds_without_a_solver(name, count, no_solver):  # noqa: ARG001
    rows = episode_rows(OpenLoop([DROP]), name, episodes=count)
    known = drawn_k_star(name, EVALUATION_SEED + np.arange(count))
    assert np.array_equal(rows["seed"], EVALUATION_SEED + np.arange(count))
    assert np.array_equal(rows["k_star"], known.k_star)
    assert np.array_equal(rows["proven"], known.proven)
    assert set(rows["scenario"]) == {name}
    assert rows["gap"].isna().all()


def test_every_episode_of_a_distribution_is_compared_with_its_own_k_star(near, tmp_path):
    actions = padded(near)
    actions[1] = DROP
    rows = episode_rows(OpenLoop(actions), GOALS, 3, seed=0, store=tmp_path)
    assert rows["outcome"].tolist() == ["goal", rows["outcome"][1], "goal"]
    assert rows["k_star"].tolist() == pytest.approx([near[0].steps, np.nan, near[2].steps], nan_ok=True)
    assert rows["gap"].tolist() == pytest.approx([0, np.nan, 0], nan_ok=True)
    row = evaluate(OpenLoop(actions), GOALS, 3, seed=0, store=tmp_path).iloc[0]
    assert row.success_rate == pytest.approx(2 / 3)
    assert row.steps == row.k_star == iqm([near[0].steps, near[2].steps])
    assert (row.gap, row.scenario) == (0, label(GOALS))
    assert summary(rows.assign(agent="replay"))["success_rate"].tolist() == [row.success_rate]


def test_computed_optima_are_cached(near, tmp_path, monkeypatch):
    first = episode_rows(OpenLoop(padded(near)), GOALS, 3, seed=0, store=tmp_path)
    monkeypatch.setattr("joblib.Parallel", None)
    assert first.equals(episode_rows(OpenLoop(padded(near)), GOALS, 3, seed=0, store=tmp_path))


def test_episodes_of_a_distribution_have_the_scenarios_of_their_seeds(near):
    flights = fly(OpenLoop(padded(near[1:])), GOALS, episodes=2, seed=1)
    assert flights.outcomes == ("goal", "goal")
    assert flights.hoops_passed.tolist() == [0, 0]
    for flown, flight in zip(flights.states, near[1:], strict=True):
        np.testing.assert_allclose(flown, flight.states, atol=1e-12)


def test_hoops_passed_are_returned():
    known = reference("slalom")
    assert fly(OpenLoop(known.actions), "slalom").hoops_passed.tolist() == [3]
    assert fly(OpenLoop([HOVER]), "slalom").hoops_passed.tolist() == [0]


def test_episode_starts_are_passed_to_stateful_policies(near):
    """Episodes end at different steps; `episode_start` marks the resets of the environment."""
    reported = []

    class Told(OpenLoop):
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            reported.append((observation[:, -1] == 0, episode_start))
            return super().predict(observation, state, episode_start, deterministic)

    flown = fly(Told(np.concatenate([padded(near[:2]), [[DROP] * max(f.steps for f in near[:2])]])), GOALS, 3)
    assert len(set(flown.steps)) > 1
    assert all(np.array_equal(at_start, start) for at_start, start in reported)
    assert sum(start.sum() for _, start in reported) > 3


def test_faster_than_optimal_holds_the_evidence(optimum):
    wrong = replace(optimum, steps=optimum.steps + 1)
    with pytest.raises(FasterThanOptimal, match="K\\* is wrong") as failure:
        evaluate(OpenLoop(optimum.actions), "horizontal-3", episodes=1, optimum=wrong)
    assert failure.value.scenario == optimum.scenario
    np.testing.assert_array_equal(failure.value.actions, optimum.actions)
    np.testing.assert_allclose(failure.value.states, optimum.states, atol=1e-12)


def test_faster_than_the_k_star_of_a_sampled_scenario_raises(near, monkeypatch):
    late = [flight if i < 2 else replace(flight, steps=flight.steps + 1) for i, flight in enumerate(near)]
    monkeypatch.setattr(module, "fewest_steps_many", lambda *_, **__: late)
    with pytest.raises(FasterThanOptimal, match="near-2-0") as failure:
        evaluate(OpenLoop(padded(near)), GOALS, 3, seed=0)
    assert failure.value.scenario == near[2].scenario
    np.testing.assert_array_equal(failure.value.actions, near[2].actions)


def test_episodes_hold_their_states(optimum):
    flights = fly(OpenLoop(optimum.actions), SCENARIOS["horizontal-3"], episodes=2)
    assert flights.outcomes == ("goal", "goal")
    np.testing.assert_allclose(flights.states[1], optimum.states, atol=1e-12)


def test_a_failed_episode_needs_no_k_star(no_solver, tmp_path):  # noqa: ARG001
    row = evaluate(OpenLoop([DROP]), GOALS, 3, seed=0, store=tmp_path).iloc[0]
    assert row.success_rate == 0
    assert np.isnan([row.k_star, row.gap, row.gap_low, row.gap_high]).all()


def test_a_score_is_not_lost_where_k_star_is_not_found(near, monkeypatch):
    lost = [replace(near[0], steps=np.inf), near[2]]
    monkeypatch.setattr(module, "fewest_steps_many", lambda *_, **__: lost)
    actions = padded(near)
    actions[1] = DROP
    row = evaluate(OpenLoop(actions), GOALS, 3, seed=0).iloc[0]
    assert row.success_rate == pytest.approx(2 / 3)
    assert (row.k_star, row.gap, row.proven) == (near[2].steps, 0, False)
    monkeypatch.setattr(module, "fewest_steps_many", lambda *_, **__: lost[:1])
    own = replace(SCENARIOS["horizontal-3"], name="own", time_limit=6.0)
    row = evaluate(OpenLoop(reference("horizontal-3").actions), own, 1).iloc[0]
    assert (row.success_rate, row.steps) == (1, reference("horizontal-3").k_star)
    assert np.isnan([row.k_star, row.gap]).all()


def test_intervals_are_those_of_the_bootstrap():
    rows = episode_rows(Hasty(), "random-goal", episodes=40)
    row, spread = score_row(rows).iloc[0], summary(rows, by=("scenario",)).iloc[0]
    for name in ("success_rate", "success_low", "success_high", "steps", "gap", "gap_low", "gap_high"):
        assert row[name] == spread[name]
    assert row.success_low < row.success_rate < row.success_high
    assert row.gap_low < row.gap < row.gap_high


def test_invalid_arguments_are_refused(optimum):
    with pytest.raises(ValueError, match="episodes must be at least 1, got 0"):
        fly(OpenLoop(optimum.actions), "horizontal-3", episodes=0)
    with pytest.raises(ValueError, match=r"unknown columns \['colour'\]"):
        evaluate(OpenLoop(optimum.actions), "horizontal-3", optimum=optimum, colour="red")
    with pytest.raises(ValueError, match="must be finite"):
        fly(OpenLoop([[np.nan, 0.0]]), "horizontal-3")
    with pytest.raises(ValueError, match=r"must have shape \(1, 2\)"):
        fly(OpenLoop([[0.0, 0.0, 0.0]]), "horizontal-3")
    with pytest.raises(ValueError, match="optimum must be one of 'hoop', got that of 'horizontal-3'"):
        evaluate(OpenLoop(optimum.actions), "hoop", optimum=optimum)


@pytest.mark.parametrize(
    ("spaces", "words"),
    [
        ({"observation_space": gym.spaces.Box(-1, 1, (7,))}, r"observation_space of shape \(7,\).*\(19,\)"),
        ({"action_space": gym.spaces.Box(-1, 1, (3,))}, r"action_space of shape \(3,\).*\(2,\)"),
        ({"action_space": gym.spaces.Discrete(4)}, r"action_space of shape \(\), Discrete\(4\).*\(2,\)"),
    ],
    ids=["observations", "actions", "discrete"],
)
def test_a_policy_with_other_spaces_is_refused_before_the_first_step(spaces, words):
    class Foreign:
        def predict(self, *_, **__):
            raise AssertionError("predict was called")

    foreign = Foreign()
    vars(foreign).update(spaces)
    with pytest.raises(ValueError, match=words):
        fly(foreign, "hoop")


def test_disturbances_are_recorded_and_allow_fewer_steps_than_k_star(optimum):
    late = replace(optimum, steps=1000)
    nominal, windy = (
        evaluate(OpenLoop([HOVER]), "horizontal-3", 4, optimum=late, disturbances=disturbances).iloc[0]
        for disturbances in (Disturbances(), Disturbances(wind=3.0, sensor_noise=0.01))
    )
    assert (nominal.disturbances, nominal.outcomes) == ({}, {"time-limit": 4})
    assert windy.disturbances == {"wind": 3.0, "sensor_noise": 0.01}
    assert windy.outcomes != nominal.outcomes
    # The same episode raises without disturbances and does not with sensor noise.
    with pytest.raises(FasterThanOptimal):
        evaluate(OpenLoop(optimum.actions), "horizontal-3", optimum=late)
    row = evaluate(
        OpenLoop(optimum.actions), "horizontal-3", 2, optimum=late, disturbances=Disturbances(sensor_noise=0.01)
    )
    assert row.iloc[0].steps == optimum.steps
