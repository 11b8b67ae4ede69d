"""Imitation: what was shown is learnt, the mirror knows no difference, and the best round is kept."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from agents import demonstrations, policies
from agents.advice import backwards, brought_back, hoops_along, regulated, replanned, seen_along
from agents.configs import PPOConfig
from agents.evaluate import fly
from agents.experts import Expert
from agents.imitation import (
    CloneConfig,
    DaggerConfig,
    Keeper,
    Shown,
    batches,
    clone,
    dagger,
    fit,
    joined,
    loss,
    mirrored,
    recorded,
    student,
)
from agents.train import train
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.reference import ghost_states, reference
from flatgym.scene import Scene
from flatgym.task import fly_actions, observe
from optimal import fewest_steps, fewest_steps_many

SMALL = CloneConfig(scenario="horizontal-3", width=32, depth=2, batch=128, updates=300)


@pytest.fixture(scope="module")
def flight():
    return fewest_steps("horizontal-3", windings=(0,), time_budget=0.0)


@pytest.fixture(scope="module")
def shown(flight):
    return regulated(Expert(flight), flight.scenario, flights=8)(None, 0)


def test_beyond_the_same_limit_nothing_is_lost():
    output = torch.tensor([[1.7, -0.5], [-3.0, 0.9], [0.5, -1.0]])
    action = torch.tensor([[1.0, 1.0], [-1.0, 0.5], [1.0, 1.0]])
    expected = torch.tensor([[0.0, 2.25], [0.0, 0.16], [0.25, 4.0]])
    torch.testing.assert_close(loss(output, action), expected)


def test_batches_pass_over_all_rows_alike():
    rows = torch.cat(list(batches(100, replace(SMALL, batch=30, updates=10))))
    assert len(rows) == 300
    assert torch.bincount(rows, minlength=100).min() >= 2


def test_fitting_lowers_the_error_and_leaves_the_critic_alone(shown):
    model = student(SMALL)
    critic = [value.clone() for value in model.policy.mlp_extractor.value_net.parameters()]
    first = fit(model, shown, replace(SMALL, updates=10))
    assert fit(model, shown, SMALL) < first / 3
    for before, after in zip(critic, model.policy.mlp_extractor.value_net.parameters(), strict=True):
        torch.testing.assert_close(before, after, rtol=0, atol=0)


def test_the_same_seed_gives_the_same_clone_and_another_another(shown):
    brief = replace(SMALL, updates=20)
    one, same, other = (clone(shown, config) for config in (brief, brief, replace(brief, seed=1)))
    actions = [model.predict(shown.observations, deterministic=True)[0] for model in (one, same, other)]
    np.testing.assert_array_equal(actions[0], actions[1])
    assert not np.allclose(actions[0], actions[2])


def test_a_clone_is_saved_and_ppo_goes_on_from_it(shown, tmp_path):
    model = clone(shown, replace(SMALL, updates=20))
    file = policies.save(model, tmp_path / "clone.zip", "horizontal-3")
    loaded = policies.load(file, trust=True)
    expected = model.predict(shown.observations, deterministic=True)[0]
    np.testing.assert_array_equal(loaded.predict(shown.observations, deterministic=True)[0], expected)
    tuned = train(
        PPOConfig(
            scenario="horizontal-3", policy=str(file), num_envs=16, rollout=16, batch=128, env_steps=512,
            folder=str(tmp_path / "ppo"),
        )
    )  # fmt: skip
    assert tuned.env_steps == 512


def test_demonstrations_are_read_and_those_of_another_scenario_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    planned = demonstrations.plan("horizontal-3", 2, jobs=1)
    dataset = demonstrations.record("horizontal-3", planned)
    found = recorded(dataset, "horizontal-3")
    assert found.observations.shape == (sum(one.steps for one in planned), 19)
    np.testing.assert_array_equal(found.actions[: planned[0].steps], planned[0].flight.actions)
    with pytest.raises(ValueError, match="horizontal-6"):
        recorded(dataset, "horizontal-6")


@pytest.mark.parametrize("name", ["climb", "slalom"])
def test_what_is_seen_in_the_mirror_is_a_flight_of_the_mirrored_scenario(name):
    scenario, actions = SCENARIOS[name], reference(name).actions
    shown = seen_along(scenario, ghost_states(name), actions)
    reflected = replace(
        scenario,
        start=(-scenario.start[0], scenario.start[1]),
        goal=(-scenario.goal[0], scenario.goal[1]),
        hoops=tuple(replace(hoop, x=-hoop.x, angle=np.pi - hoop.angle) for hoop in scenario.hoops),
    )
    twice, turned = mirrored(shown), actions * np.array([1, -1], dtype=np.float32)
    flown = fly_actions(reflected, turned)
    seen = np.concatenate([observe(Scene.of([reflected]), situation) for situation in flown[:-1]])
    np.testing.assert_allclose(twice.observations[len(actions) :], seen, atol=2e-5)
    np.testing.assert_array_equal(twice.actions[len(actions) :], turned)


@pytest.mark.parametrize("name", ["climb", "high-hoop", "loop"])
def test_backwards_in_time_a_flight_is_a_flight_from_the_goal_to_the_start(name):
    scenario, states, actions = SCENARIOS[name], ghost_states(name), reference(name).actions
    back, turned, rates = backwards(scenario, states, actions)
    flown = back.quadrotor.step(turned[:-1], back.quadrotor.control(rates), back.dt)
    np.testing.assert_allclose(flown, turned[1:], atol=1e-6)
    np.testing.assert_allclose(turned[-1, :4], [*scenario.start, 0, 0])
    assert back.start == scenario.goal
    assert hoops_along(back, turned, rates)[-1] == len(scenario.hoops)
    again = backwards(back, turned, rates)
    np.testing.assert_array_equal(again[1], states)
    np.testing.assert_array_equal(again[2], actions)


def test_who_has_missed_a_hoop_is_told_to_turn_back():
    scenario = SCENARIOS["hoop"]
    (hoop,) = scenario.hoops
    behind = np.array([hoop.x + 0.5, hoop.z + hoop.diameter, 0.0, 0.0, 0.0]) + np.zeros((7, 5))
    shown = brought_back(scenario, behind, np.zeros(7, dtype=np.int64), np.arange(100, 107))
    assert len(shown.actions) == shown.asked == 3
    assert (shown.actions[:, 1] < 0).all()
    past = brought_back(scenario, behind, np.ones(7, dtype=np.int64), np.arange(100, 107))
    assert (past.actions[:, 1] > 0).all()
    assert brought_back(scenario, behind[:0], *np.zeros((2, 0), dtype=np.int64)).asked == 0


@pytest.mark.parametrize("name", ["hoop", "loop"])
def test_hoops_are_counted_as_the_environment_counts_them(name):
    flown = fly_actions(SCENARIOS[name], reference(name).actions)
    states = np.array([situation.state[0] for situation in flown])
    counted = hoops_along(SCENARIOS[name], states, reference(name).actions)
    assert counted.tolist() == [situation.hoops_passed[0] for situation in flown]


def test_advice_on_the_way_is_what_the_expert_does_and_the_first_flight_is_undisturbed(flight, shown):
    expert = Expert(flight)
    np.testing.assert_allclose(expert.predict(shown.observations)[0], shown.actions, atol=2e-3)
    alone = regulated(expert, flight.scenario, flights=1)(None, 0)
    assert len(alone.actions) == flight.steps
    again = regulated(expert, flight.scenario, flights=8)(None, 0)
    np.testing.assert_array_equal(again.observations, shown.observations)


def test_dagger_keeps_the_best_round_and_stops_when_satisfied(flight):
    config = DaggerConfig(scenario="horizontal-3", width=64, updates=400, rounds=3, batch=256)
    points = []
    keeper = Keeper(config, target=flight.steps, watch=points.append)
    model = dagger(student(config), regulated(Expert(flight), flight.scenario, flights=8), config, keeper)
    assert points == keeper.curve
    assert 1 <= len(points) <= 3
    assert keeper.env_steps > 0 or len(points) == 1
    best = max(points, key=lambda point: (point["success_rate"], -point["steps"]))
    flown = fly(model, "horizontal-3")
    assert (flown.steps[0], flown.outcomes[0]) == (best["steps"], best["outcome"])
    content = Keeper(config, target=1000)
    dagger(student(config), lambda *_: Shown(*map(np.asarray, regulated(Expert(flight), flight.scenario)(None, 0))),
           replace(config, rounds=2), content)  # fmt: skip
    assert len(content.curve) in (1, 2)


def test_replanned_advice_leads_to_the_goal_and_comes_in_mirrored_pairs():
    distribution = DISTRIBUTIONS["random-goal"]
    flights = fewest_steps_many([distribution.scenario(i) for i in range(3)], jobs=1, progress=False)
    adviser = replanned(flights, distribution, count=2, every=20, ahead=5, jobs=1)
    own = adviser(None, 0)
    assert len(own.actions) == 4 * own.asked == 4 * sum(flight.steps for flight in flights)
    model = clone(own, CloneConfig(scenario="random-goal", width=32, depth=2, batch=128, updates=100))
    advice = adviser(model, 1)
    half = len(advice.actions) // 2
    assert half > 5
    np.testing.assert_array_equal(advice.actions[:half, 0], advice.actions[half:, 0])
    np.testing.assert_array_equal(advice.actions[:half, 1], -advice.actions[half:, 1])
    assert len(joined([own, advice]).actions) == len(own.actions) + 2 * half
    assert advice.asked == half


@pytest.mark.parametrize(("field", "value"), [("updates", 0), ("zoom", -1.0), ("seed", 1.5), ("scenario", "nowhere")])
def test_bad_fields_are_named(field, value):
    with pytest.raises(ValueError, match=field if field != "scenario" else "nowhere"):
        CloneConfig(**{field: value})
