"""Self-imitation: recorded flights replay, the best is kept, and a fitted policy flies it."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from agents.evaluation.rollouts import fly
from agents.training.configs import PPOConfig
from agents.training.curriculum import curriculum
from agents.training.models import build
from agents.training.self_imitation import Flight, FlightRecorder, excess
from agents.training.train import train
from agents.training.vec_env import make_vec_env
from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference
from flatgym.scenarios.scenario import Tolerance
from flatgym.task.rollout import replay_to_goal

N_ENVS = 16
EASY = replace(SCENARIOS["horizontal-3"], goal=(1.0, 0.0), tolerance=Tolerance(0.6, 4.0, 1.0), time_limit=1.2)
"""A scenario that random flights solve now and then."""


def recorded(scenario, policy, steps, **arguments):
    """Return the recorder of `steps` steps of N_ENVS vehicles, and the lengths of the flights that succeeded."""
    envs = make_vec_env(scenario, N_ENVS, seed=0, **arguments)
    envs.reset()
    recorder, lengths = FlightRecorder(scenario, envs.arrays["state"]), []
    for _ in range(steps):
        actions = policy(envs)
        _, _, dones, infos = envs.step(actions)
        recorder.step(actions, envs.arrays["state"], dones, infos)
        lengths += [infos[i]["steps"] for i in np.flatnonzero(dones) if infos[i]["is_success"]]
    return recorder, lengths


def random_actions(generator):
    return lambda _: generator.uniform(-1, 1, (N_ENVS, 2)).astype(np.float32)


def test_the_best_flight_is_the_shortest_and_replays_to_the_goal(generator):
    recorder, lengths = recorded(EASY, random_actions(generator), 600)
    assert len(set(lengths)) > 2
    actions = recorder.best.actions.numpy()
    assert len(actions) == min(lengths)
    states = replay_to_goal(EASY, actions)
    assert len(states) == len(actions) + 1
    assert recorder.best.excess == pytest.approx(excess(EASY, states[-2]))


def test_a_flight_would_have_ended_earlier_with_an_excess_below_one(generator):
    recorder, _ = recorded(EASY, random_actions(generator), 600)
    states = replay_to_goal(EASY, recorder.best.actions.numpy())
    assert excess(EASY, states[-1]) <= 1 < recorder.best.excess


def test_flights_from_a_pool_of_starts_do_not_count():
    pool = replace(curriculum(PPOConfig(scenario="horizontal-3")).pool, share=1.0)
    known = reference(SCENARIOS["horizontal-3"]).actions.astype(np.float32)

    def policy(envs):
        return known[np.minimum(envs.arrays["steps"], len(known) - 1)]

    recorder, _ = recorded(SCENARIOS["horizontal-3"], policy, len(known) + 1, starts=pool)
    assert recorder.best is None or len(recorder.best.actions) == len(known)
    mixed, _ = recorded(SCENARIOS["horizontal-3"], policy, len(known) + 1, starts=replace(pool, share=0.5))
    assert np.array_equal(mixed.best.actions.numpy(), known)


def test_a_fitted_policy_flies_the_flight():
    scenario, levels = SCENARIOS["hoop"], np.linspace(-1, 1, 5, dtype=np.float32)
    choice = np.random.default_rng(0).integers(5, size=(4, 2)).repeat(8, axis=0)
    flight = Flight(scenario, torch.from_numpy(levels[choice]), 1.0)
    model = build(PPOConfig(scenario="hoop", bins=(5, 5), learning_rate=0.01, num_envs=1, batch_size=64))
    before = fly(model, scenario, 1).actions[0][: len(choice)]
    flight.fit(model, 200)
    after = fly(model, scenario, 1).actions[0][: len(choice)]
    assert not np.array_equal(before, flight.actions.numpy())
    assert np.array_equal(after, flight.actions.numpy())


@pytest.mark.parametrize("self_imitation", [0, 8])
def test_a_training_ends_with_a_policy_as_fast_as_its_best_flight(tmp_path, self_imitation):
    config = PPOConfig(
        scenario=EASY.to_json(), env_steps=4096, num_envs=64, n_steps=16, batch_size=256, tolerance=1.0, width=16,
        self_imitation=self_imitation, folder=str(tmp_path), checkpoint_every=2,
    )  # fmt: skip
    training = train(config)
    stored = torch.load(tmp_path / "checkpoint.pt", weights_only=True)["progress"]["flight"]
    assert (stored is None) == (self_imitation == 0)
    if stored is not None:
        assert training.best["steps"] <= len(stored[0])
        assert len(replay_to_goal(EASY, stored[0].numpy())) == len(stored[0]) + 1
    assert json.loads((tmp_path / "config.json").read_text())["self_imitation"] == self_imitation


def test_during_warmup_the_actor_imitates_nothing(tmp_path):
    config = PPOConfig(
        scenario=EASY.to_json(), env_steps=2048, num_envs=64, n_steps=16, batch_size=256, tolerance=1.0, width=16,
        self_imitation=0, folder=str(tmp_path / "first"),
    )  # fmt: skip
    policy, folder = train(config).model, tmp_path / "second"
    train(replace(config, self_imitation=8, policy=str(policy), value_warmup=100, folder=str(folder)))
    flight = torch.load(folder / "checkpoint.pt", weights_only=True)["progress"]["flight"]
    points = [json.loads(line) for line in (folder / "curve.jsonl").read_text().splitlines()]
    assert flight is not None
    assert len({(point["outcome"], point["steps"]) for point in points}) == 1
