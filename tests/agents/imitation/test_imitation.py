"""Imitation: what was shown is learnt, the mirror knows no difference, and the best round is kept."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from agents import demonstrations, policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.tracking import Expert
from agents.evaluation.rollouts import fly
from agents.imitation.cloning import CloneConfig, batches, clone, fit, loss, untrained_policy
from agents.imitation.dataset import ExpertData, load_expert_data, with_mirror_images
from agents.imitation.dataset_aggregation import DaggerConfig, dagger
from agents.imitation.oracles import backwards, combined_oracle, corrected, hoops_along, lqr_oracle, seen_along
from agents.imitation.selection import BestPolicy
from agents.training.configs import PPOConfig
from agents.training.train import train
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.task.observation import observe
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import Scene
from optimal import fewest_steps, fewest_steps_many

SMALL = CloneConfig(scenario="horizontal-3", width=32, depth=2, batch_size=128, gradient_steps=300)


@pytest.fixture(scope="module")
def flight():
    return fewest_steps("horizontal-3", windings=(0,), time_budget=0.0)


@pytest.fixture(scope="module")
def shown(flight):
    return lqr_oracle([flight], count=8)(None, 0)


def test_beyond_the_same_limit_nothing_is_lost():
    output = torch.tensor([[1.7, -0.5], [-3.0, 0.9], [0.5, -1.0]])
    action = torch.tensor([[1.0, 1.0], [-1.0, 0.5], [1.0, 1.0]])
    expected = torch.tensor([[0.0, 2.25], [0.0, 0.16], [0.25, 4.0]])
    torch.testing.assert_close(loss(output, action), expected)


def test_batches_pass_over_all_rows_alike():
    rows = torch.cat(list(batches(100, replace(SMALL, batch_size=30, gradient_steps=10))))
    assert len(rows) == 300
    assert torch.bincount(rows, minlength=100).min() >= 2


def test_fitting_lowers_the_error_and_leaves_the_critic_alone(shown):
    model = untrained_policy(SMALL)
    critic = [value.clone() for value in model.policy.mlp_extractor.value_net.parameters()]
    first = fit(model, shown, replace(SMALL, gradient_steps=10))
    assert fit(model, shown, SMALL) < first / 3
    for before, after in zip(critic, model.policy.mlp_extractor.value_net.parameters(), strict=True):
        torch.testing.assert_close(before, after, rtol=0, atol=0)


def test_the_same_seed_gives_the_same_clone_and_another_another(shown):
    brief = replace(SMALL, gradient_steps=20)
    one, same, other = (clone(shown, config) for config in (brief, brief, replace(brief, seed=1)))
    actions = [model.predict(shown.observations, deterministic=True)[0] for model in (one, same, other)]
    np.testing.assert_array_equal(actions[0], actions[1])
    assert not np.allclose(actions[0], actions[2])


def test_a_clone_is_saved_and_ppo_goes_on_from_it(shown, tmp_path):
    model = clone(shown, replace(SMALL, gradient_steps=20))
    file = policies.save(model, tmp_path / "clone.zip", "horizontal-3")
    loaded = policies.load(file, trust=True)
    expected = model.predict(shown.observations, deterministic=True)[0]
    np.testing.assert_array_equal(loaded.predict(shown.observations, deterministic=True)[0], expected)
    tuned = train(
        PPOConfig(
            scenario="horizontal-3", policy=str(file), num_envs=16, n_steps=16, batch_size=128, env_steps=512,
            folder=str(tmp_path / "ppo"),
        )
    )  # fmt: skip
    assert tuned.env_steps == 512


def test_demonstrations_are_read_and_those_of_another_scenario_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    planned = demonstrations.plan("horizontal-3", 2, jobs=1)
    dataset = demonstrations.record("horizontal-3", planned)
    found = load_expert_data(dataset, "horizontal-3")
    assert found.observations.shape == (sum(one.steps for one in planned), 19)
    np.testing.assert_array_equal(found.actions[: planned[0].steps], planned[0].flight.actions)
    with pytest.raises(ValueError, match="horizontal-6"):
        load_expert_data(dataset, "horizontal-6")


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
    twice, turned = with_mirror_images(shown), actions * np.array([1, -1], dtype=np.float32)
    flown = fly_actions(reflected, turned)
    seen = np.concatenate([observe(Scene.of([reflected]), situation) for situation in flown[:-1]])
    np.testing.assert_allclose(twice.observations[len(actions) :], seen, atol=2e-5)
    np.testing.assert_array_equal(twice.actions[len(actions) :], turned)


@pytest.mark.parametrize("name", ["climb", "hoop", "high-hoop", "loop"])
def test_backwards_in_time_a_flight_is_a_flight_from_the_goal_to_the_start(flight, name):
    known = reference(name)
    flown = {"states": ghost_states(name), "actions": known.actions, "winding": known.winding}
    flight = replace(flight, scenario=SCENARIOS[name], **flown)
    back = backwards(flight)
    flown = back.scenario.quadrotor.step(back.states[:-1], back.scenario.quadrotor.control(back.actions), 0.02)
    np.testing.assert_allclose(flown, back.states[1:], atol=1e-6)
    assert (back.scenario.start, back.scenario.goal) == (flight.scenario.goal, flight.scenario.start)
    np.testing.assert_allclose(back.states[-1, :4], [*flight.scenario.start, 0, 0])
    assert np.abs(back.states[0] - back.scenario.start_state).max() <= 0.2  # the tolerance
    assert hoops_along(back.scenario, back.states, back.actions)[-1] == len(flight.scenario.hoops)
    again = backwards(back)
    np.testing.assert_allclose(again.states, flight.states, atol=1e-12)
    np.testing.assert_array_equal(again.actions, flight.actions)


@pytest.mark.parametrize("name", ["hoop", "loop"])
def test_hoops_are_counted_as_the_environment_counts_them(name):
    flown = fly_actions(SCENARIOS[name], reference(name).actions)
    states = np.array([situation.state[0] for situation in flown])
    counted = hoops_along(SCENARIOS[name], states, reference(name).actions)
    assert counted.tolist() == [situation.hoops_passed[0] for situation in flown]


def test_advice_on_the_way_is_what_the_expert_does_and_the_first_flight_is_undisturbed(flight, shown):
    expert = Expert(flight)
    np.testing.assert_allclose(expert.predict(shown.observations)[0], shown.actions, atol=2e-3)
    alone = lqr_oracle([flight], count=1)(None, 0)
    assert len(alone.actions) == flight.steps
    again = lqr_oracle([flight], count=8)(None, 0)
    np.testing.assert_array_equal(again.observations, shown.observations)


def test_dagger_keeps_the_best_round_and_stops_when_satisfied(flight):
    config = DaggerConfig(scenario="horizontal-3", width=64, gradient_steps=400, rounds=3, batch_size=256)
    points = []
    best = BestPolicy(config, target=flight.steps, on_validation=points.append)
    model = dagger(untrained_policy(config), lqr_oracle([flight], count=8), config, keeper)
    assert points == keeper.curve
    assert 1 <= len(points) <= 3
    assert keeper.env_steps > 0 or len(points) == 1
    best = max(points, key=lambda point: (point["success_rate"], -point["steps"]))
    flown = fly(model, "horizontal-3")
    assert (flown.steps[0], flown.outcomes[0]) == (best["steps"], best["outcome"])
    content = BestPolicy(config, target=1000)
    dagger(untrained_policy(config), lambda *_: ExpertData(*map(np.asarray, lqr_oracle([flight])(None, 0))),
           replace(config, rounds=2), content)  # fmt: skip
    assert len(content.curve) in (1, 2)


@pytest.fixture(scope="module")
def drawn():
    distribution = DISTRIBUTIONS["random-hoops"]
    return distribution, fewest_steps_many([distribution.scenario(i) for i in range(3)], jobs=1, progress=False)


def test_guided_advice_comes_in_mirrored_pairs_and_counts_what_was_flown(drawn):
    distribution, flights = drawn
    adviser = combined_oracle(
        flights, distribution, count=6, plan_episodes=2, plan_every=20, plan_steps=5, plan_weight=2, jobs=1
    )
    own = adviser(None, 0)
    assert own.env_steps == 0
    assert len(own.actions) == 2 * own.labels >= 2 * flights[0].steps
    model = clone(
        own, CloneConfig(scenario="random-hoops", width=32, depth=2, batch_size=128, gradient_steps=100, guidance=True)
    )
    advice = adviser(model, 1)
    half = len(advice.actions) // 2
    np.testing.assert_array_equal(advice.actions[:half, 0], advice.actions[half:, 0])
    np.testing.assert_array_equal(advice.actions[:half, 1], -advice.actions[half:, 1])
    again = adviser(model, 1)
    np.testing.assert_array_equal(again.observations, advice.observations)
    about = [*flights, *map(backwards, flights)]
    followed = lqr_oracle(
        about, count=6, start_noise=0.3, window=range(-6, 4), fallback=CascadedPD(), after_last_hoop=False
    )(model, 1)
    assert advice.env_steps == followed.env_steps + fly(model, distribution, 2, 0).steps.sum()
    assert half >= advice.labels > 0


def test_behind_the_last_hoop_who_flies_optimally_is_told_to_go_on(drawn):
    for flight in drawn[1]:
        passed = hoops_along(flight.scenario, flight.states, flight.actions)
        since = int(np.argmax(passed == len(flight.scenario.hoops)))
        plan = corrected(flight, flight.states, flight.actions, every=200, ahead=100)
        assert flight.steps - since - 1 <= plan.labels <= flight.steps - since + 1  # a step is what care may cost
        own = seen_along(flight.scenario, flight.states, flight.actions)
        np.testing.assert_allclose(plan.observations[0], own.observations[since], atol=1e-6)


def test_before_the_last_hoop_nobody_plans_anew(drawn):
    flight = drawn[1][0]
    beside = flight.states[:20] + np.array([3.0, 3.0, 0.0, 0.0, 0.0])
    assert corrected(flight, beside, flight.actions[:19], every=5, ahead=30).labels == 0


class Fixed:
    """A learner, or a rescuer, that does always the same."""

    def __init__(self, thrust, rate):
        self.action = np.array([thrust, rate], dtype=np.float32)

    def predict(self, observations, **_):
        return np.broadcast_to(self.action, (len(observations), 2)), None


def test_who_is_astray_is_given_up_or_led_back_by_the_rescuer(flight):
    climbing = Fixed(1.0, 0.0)
    given_up = lqr_oracle([flight], count=1)(climbing, 1)
    assert 0 < given_up.env_steps == given_up.labels == len(given_up.actions) < flight.steps
    rescued = lqr_oracle([flight], count=1, fallback=Fixed(-0.25, 0.125))(climbing, 1)
    np.testing.assert_array_equal(rescued.actions[: given_up.labels], given_up.actions)
    assert rescued.env_steps > given_up.env_steps
    assert (rescued.actions[given_up.labels :] == [-0.25, 0.125]).all()
    assert rescued.labels == rescued.env_steps


def test_who_has_missed_a_hoop_is_led_back_until_it_is_passed():
    scenario = SCENARIOS["high-hoop"]
    flight = fewest_steps("high-hoop", windings=(reference("high-hoop").winding,), time_budget=0.0)
    straight = fewest_steps("diagonal", windings=(0,), time_budget=0.0)  # to the same goal, not through the hoop
    assert straight.scenario.goal == scenario.goal
    pilot = Expert(straight)
    given_up = lqr_oracle([flight], count=1)(pilot, 1)
    rescued = lqr_oracle([flight], count=1, fallback=Fixed(-0.25, 0.125))(pilot, 1)
    assert len(given_up.actions) < len(rescued.actions)
    assert (rescued.actions[-20:] == [-0.25, 0.125]).all()


def test_at_the_goal_hovering_is_thinned(flight):
    on_time = lqr_oracle([flight], count=3, start_noise=0.0, action_noise=0.0)(None, 0)
    assert len(on_time.actions) == 3 * flight.steps
    ended = lqr_oracle([flight, flight], count=2, start_noise=0.0, action_noise=0.0)(Expert(flight, max_lag=1), 1)
    assert ended.env_steps == ended.labels == 2 * flight.steps
    hovering = lqr_oracle([flight], count=1)(Aside(Expert(flight, max_lag=1)), 1)
    assert hovering.env_steps == flight.scenario.max_steps
    assert hovering.labels == flight.steps + len(range(flight.steps + (-flight.steps) % 3, hovering.env_steps, 3))


def test_a_learner_behind_the_last_hoop_may_be_left_to_others(flight):
    alone = lqr_oracle([flight], count=1, after_last_hoop=False)
    assert alone(None, 0).labels == flight.steps
    assert alone(Expert(flight, max_lag=1), 1).labels == 0  # there is no hoop at all


class Aside:
    """A pilot that takes the goal to be 30 cm higher than it is, and waits there."""

    def __init__(self, pilot):
        self.pilot = pilot

    def predict(self, observations, **_):
        return self.pilot.predict(observations + 0.15 * np.eye(19, dtype=np.float32)[1])


@pytest.mark.parametrize(
    ("field", "value"), [("gradient_steps", 0), ("observation_scale", -1.0), ("seed", 1.5), ("scenario", "nowhere")]
)
def test_bad_fields_are_named(field, value):
    with pytest.raises(ValueError, match=field if field != "scenario" else "nowhere"):
        CloneConfig(**{field: value})
