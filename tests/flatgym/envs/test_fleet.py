"""The compiled fleet equals the NumPy fleet to 1e-9."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from flatgym import DISTRIBUTIONS, OUTCOMES, SCENARIOS, Disturbances, Hoop, Quadrotor, Scenario, Tolerance
from flatgym.envs.compiled_fleet import CompiledFleet
from flatgym.envs.config import EnvConfig, Starts
from flatgym.envs.fleet import END, HOOPS_PASSED, OUTCOME
from flatgym.envs.fleet_selection import make_fleet
from flatgym.envs.numpy_fleet import NumpyFleet
from flatgym.scenarios.catalogue import problem

N = 60
FLOWN = ("horizontal-6", "ground-6", "hoop", "loop", "zigzag-12", *DISTRIBUTIONS)
"""A scenario of each kind: without hoops, with a floor, with one hoop, with the same hoop twice, with most hoops."""
ALL = np.ones(N, dtype=bool)
EVERYTHING = Disturbances(wind=2.0, thrust_gain=0.1, mass=0.1, action_delay=3, sensor_noise=0.01)


def pool(scenario, size=500, speed=6.0):
    """Starts near everything a scenario names, so that flights meet hoops, floor, goal and bounds at once."""
    generator = np.random.default_rng(1)
    places = np.array([scenario.start, scenario.goal, *((hoop.x, hoop.z) for hoop in scenario.hoops)])
    state = np.zeros((size, 5))
    state[:, 0:2] = places[generator.integers(len(places), size=size)] + generator.normal(0, 0.4, (size, 2))
    if scenario.floor is not None:
        state[:, 1] = np.maximum(state[:, 1], scenario.floor)
    state[:, 2:5] = generator.normal(0, 1, (size, 3)) * [speed, speed, 1.5] * generator.random((size, 1))
    state[::5, 0:2], state[::5, 2:5] = scenario.goal, 0.05 * state[::5, 2:5]
    passed = generator.integers(0, len(scenario.hoops) + 1, size)
    passed[::5] = len(scenario.hoops)
    return Starts(state, passed, share=0.9)


def lockstep(config, steps, same_step=True, seed=3):
    """Fly both fleets side by side; return how often each outcome was met, and the hoops passed."""
    fleets = [kind(config, N, same_step) for kind in (NumpyFleet, CompiledFleet)]
    for fleet in fleets:
        fleet.reseed(ALL, np.arange(N, dtype=np.uint64) + np.uint64(seed))
    begun = [fleet.reset(ALL) for fleet in fleets]
    np.testing.assert_allclose(begun[0][0], begun[1][0], atol=2e-7)
    generator, met, passed = np.random.default_rng(seed), np.zeros(len(OUTCOMES), dtype=int), 0
    for i in range(steps):
        if i % 6 == 0:
            actions = generator.uniform(-1.3, 1.3, (N, 2))
        plain, fast = (fly(fleet, actions) for fleet in fleets)
        agree(plain, fast)
        met += np.bincount(plain.record.numbers[END].astype(int), minlength=len(OUTCOMES))
        passed += int(plain.record.numbers[HOOPS_PASSED].sum())
    return dict(zip(OUTCOMES, met, strict=True)), passed


def fly(fleet, actions):
    fleet.actions[:] = actions
    return fleet.step()


def agree(plain, fast):
    np.testing.assert_allclose(plain.observation, fast.observation, atol=2e-7)
    np.testing.assert_allclose(plain.record.numbers, fast.record.numbers, atol=1e-9)
    np.testing.assert_array_equal(plain.record.numbers[OUTCOME], fast.record.numbers[OUTCOME])
    np.testing.assert_array_equal(plain.record.counts, fast.record.counts)
    np.testing.assert_array_equal(plain.record.flags, fast.record.flags)
    assert (plain.final is None) == (fast.final is None)
    if plain.final is not None:
        ended = plain.record.numbers[END] > 0
        np.testing.assert_allclose(plain.final[:, ended], fast.final[:, ended], atol=1e-9)
        np.testing.assert_allclose(plain.final_observation[ended], fast.final_observation[ended], atol=2e-7)


@pytest.mark.parametrize("name", FLOWN)
def test_both_fleets_agree(name):
    easy = replace(problem(name), tolerance=Tolerance(0.45, 3.0, 0.8))
    config = EnvConfig(easy, starts=pool(easy) if name in SCENARIOS else None)
    met, passed = lockstep(config, 150)
    assert sum(met.values()) > 50
    assert name in DISTRIBUTIONS or met["goal"] > 10
    assert name not in SCENARIOS or bool(passed) == bool(SCENARIOS[name].hoops)
    lockstep(replace(config, reward="sparse", observation="state"), 60, same_step=False)
    lockstep(replace(config, disturbances=EVERYTHING), 60, same_step=False)


def test_both_fleets_flown_every_outcome():
    rough = Scenario(
        "rough",
        (0, 0),
        (2, 1),
        hoops=(Hoop(1, 0.3, 0.6), Hoop(1.2, 0.6, 0.5, 1.0), Hoop(1.1, 0.3, 0.8, 2.0)),
        floor=-0.5,
        ceiling=2.0,
        quadrotor=Quadrotor(radius=0.1),
        tolerance=Tolerance(0.3, 1.0, 0.5),
        time_limit=0.5,
    )
    met, passed = lockstep(EnvConfig(rough, starts=pool(rough, speed=4.0)), 80)
    assert all(met[word] > 10 for word in OUTCOMES[1:] if word != "out-of-bounds"), met
    assert passed > 100
    fast = replace(rough, name="fast", floor=None, ceiling=None, hoops=())
    met, _ = lockstep(EnvConfig(fast, starts=pool(fast, speed=40.0)), 200)
    assert met["out-of-bounds"] > 10, met


def test_both_fleets_flown_long_steps_through_several_hoops():
    hoops = tuple(Hoop(0.3 * i, 0.1 * i, 1.0, 0.4 * i) for i in range(1, 6))
    long = Scenario("long", (0, 0), (6, 0), hoops=hoops, dt=0.3, quadrotor=Quadrotor(rate_max=20.0))
    _, passed = lockstep(EnvConfig(long, starts=pool(long, speed=10.0)), 100)
    assert passed > 100
    bodies = replace(long, quadrotor=Quadrotor(rate_max=20.0, radius=0.15))
    met, _ = lockstep(EnvConfig(bodies, starts=pool(bodies, speed=10.0)), 20)
    assert met["collision"] > 100


def test_tolerance_and_share_may_change_within_episodes():
    scenario, eased = SCENARIOS["diagonal"], Tolerance(3.0, 30.0, 3.0)
    config = EnvConfig(scenario, starts=pool(scenario))
    fleets = [kind(config, N) for kind in (NumpyFleet, CompiledFleet)]
    flown = []
    for fleet in fleets:
        fleet.reseed(ALL, np.arange(N, dtype=np.uint64))
        fleet.reset(ALL)
        for i in range(40):
            if i == 20:
                fleet.set_tolerance(eased)
                fleet.set_share(0.0)
            flown.append(fly(fleet, np.zeros((N, 2))))
    for plain, fast in zip(flown[:40], flown[40:], strict=True):
        agree(plain, fast)
    assert {fleet.config.tolerance for fleet in fleets} == {eased}
    goals = np.array([np.sum(step.record.numbers[OUTCOME] == OUTCOMES.index("goal")) for step in flown[:40]])
    assert goals[20] > goals[19]


@pytest.mark.parametrize("size", [20, 500, 2000])
def test_a_replaced_pool_of_starts_is_used_from_the_next_episode(size):
    scenario = SCENARIOS["slalom"]
    old, new = pool(scenario), pool(scenario, size, speed=3.0)
    old, new = replace(old, state=old.state + 0.1), replace(new, state=new.state - 0.1, share=0.0)
    results = []
    for kind in (NumpyFleet, CompiledFleet):
        fleet = kind(EnvConfig(scenario, starts=old), N)
        fleet.reseed(ALL, np.arange(N, dtype=np.uint64))
        fleet.reset(ALL)
        fleet.set_starts(new)
        assert fleet.config.starts is new
        assert fleet.share == old.share
        flown = fly(fleet, np.zeros((N, 2)))
        fleet.reseed(ALL, None)
        _, record = fleet.reset(ALL)
        results.append((flown, record))
        in_pool = (record.numbers[0:5].T[:, None] == new.state).all(axis=2).any(axis=1)
        assert 0.8 < in_pool.mean() < 1
    agree(results[0][0], results[1][0])
    np.testing.assert_array_equal(results[0][1].numbers, results[1][1].numbers)
    with pytest.raises(ValueError, match="hoops_passed must not exceed the 3 hoops"):
        fleet.set_starts(Starts(new.state, np.full(size, 4)))


def test_given_starts_replace_sampled_ones():
    for kind in (NumpyFleet, CompiledFleet):
        fleet, mask = kind(EnvConfig(SCENARIOS["slalom"]), N), np.arange(N) % 2 == 0
        fleet.reset(ALL)
        states = np.random.default_rng(0).normal(size=(N, 5))
        _, record = fleet.reset(mask, states, np.full(N, 2))
        np.testing.assert_array_equal(record.numbers[0:5, mask].T, states[mask])
        assert not record.numbers[0:5, ~mask].any()
        np.testing.assert_array_equal(record.counts[1], 2 * mask)


def test_without_numba_the_numpy_fleet_is_used():
    assert isinstance(make_fleet(EnvConfig(SCENARIOS["hoop"]), 2), CompiledFleet)
    code = (
        "import sys; sys.modules['numba'] = None\n"
        "import gymnasium as gym, flatgym, numpy as np\n"
        "env = gym.make('FlatQuad-v0'); env.reset(seed=0); env.step(np.zeros(2, np.float32))\n"
        "print(type(env.unwrapped.fleet).__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "NumpyFleet"


@pytest.mark.parametrize("kind", [NumpyFleet, CompiledFleet])
@pytest.mark.parametrize("dt", [0.02, 0.05, 0.1])
def test_a_line_reached_just_at_the_end_of_a_step_is_crossed_once(kind, dt):
    # At constant speed, many flights come to the line in a whole number of steps, but for rounding.
    speed = np.array([0.1 * k / (dt * m) for k in range(1, 6) for m in range(1, 11)])
    state, everyone = np.zeros((len(speed), 5)), np.ones(len(speed), dtype=bool)
    state[:, 2] = speed
    for distance in range(1, 20):
        scenario = Scenario("line", (0, 0), (9, 0), hoops=(Hoop(distance / 10, 0, 9.0),) * 2, dt=dt)
        fleet = kind(EnvConfig(scenario), len(speed))
        fleet.reset(everyone, state)
        passed = np.zeros(len(speed))
        for _ in range(40):
            fleet.actions[:] = scenario.quadrotor.action([9.81, 0.0])
            flown = fleet.step().record
            passed = np.maximum(passed, flown.numbers[HOOPS_PASSED])
        beyond = flown.numbers[0] > distance / 10 + 0.01
        assert beyond.sum() > 5
        np.testing.assert_array_equal(passed[beyond], 1)
