"""Whatever the scenario and the actions: no crash, no NaN, observations in their space, one outcome at the end."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flatgym import OUTCOMES, Hoop, Quadrotor, Scenario, Tolerance
from flatgym.env import FlatQuadEnv

length = st.floats(-8.0, 8.0)
hoops = st.lists(st.builds(Hoop, length, length, st.floats(0.5, 3.0), st.floats(-math.pi, math.pi)), max_size=3)
vehicles = st.builds(
    Quadrotor,
    thrust_min=st.floats(0.0, 5.0),
    thrust_max=st.floats(11.0, 40.0),
    rate_max=st.floats(0.5, 20.0),
    radius=st.sampled_from([0.0, 0.1]),
)
scenarios = st.builds(
    Scenario,
    name=st.just("any"),
    start=st.tuples(length, length),
    goal=st.tuples(st.floats(9.0, 12.0), length),
    hoops=hoops.map(tuple),
    floor=st.sampled_from([None, -12.0]),
    ceiling=st.sampled_from([None, 12.0]),
    quadrotor=vehicles,
    tolerance=st.builds(Tolerance, st.floats(0.05, 0.9), st.floats(0.1, 3.0), st.floats(0.05, 3.0)),
    dt=st.floats(0.005, 0.2),
    time_limit=st.floats(0.3, 2.0),
)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(scenarios, st.integers(0, 2**32 - 1))
def test_any_scenario_flies_to_one_outcome(scenario, seed):
    assert Scenario.from_json(scenario.to_json()) == scenario
    env, generator = FlatQuadEnv(scenario, reward="sparse"), np.random.default_rng(seed)
    observation, info = env.reset(seed=0)
    total, ended, passed = 0.0, False, 0
    while not ended:
        assert env.observation_space.contains(observation)
        observation, reward, terminated, truncated, info = env.step(generator.uniform(-1.5, 1.5, 2))
        assert np.isfinite(info["state"]).all()
        assert passed <= info["hoops_passed"] <= len(scenario.hoops)
        total, passed, ended = total + reward, info["hoops_passed"], terminated or truncated
        assert ended == (info["outcome"] != "flying")
    assert info["outcome"] in OUTCOMES[1:]
    limit = scenario.max_steps * scenario.dt
    assert math.isclose(-total, info["time"] if info["is_success"] else limit, rel_tol=1e-9)
