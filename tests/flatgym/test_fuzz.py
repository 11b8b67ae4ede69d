"""Whatever the scenario and the actions: no crash, no NaN, observations in their space, one outcome at the end.

Hypothesis looks for extreme scenarios and actions, a seeded loop flies many ordinary ones, where hoops, rims, floors and
goals are met. And whatever else is handed over is refused by the name of what it was handed over as.
"""

import json
import math
from dataclasses import fields, replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flatgym import (
    DISTRIBUTIONS,
    OUTCOMES,
    SCENARIOS,
    Distribution,
    Disturbances,
    Hoop,
    Quadrotor,
    Scenario,
    Tolerance,
)
from flatgym.course import Starts
from flatgym.env import FlatQuadEnv
from flatgym.fleet import Fleet, fleet_of
from flatgym.kernels import passes
from flatgym.vector import FlatQuadVectorEnv

MOST = 1e6  # what numbers of a scenario may be


def fuzz(examples):
    return settings(derandomize=True, max_examples=examples, deadline=None)


# Extreme scenarios and actions


def upto(most, least=-math.inf):
    """Numbers of every magnitude up to `most`, and the corners."""
    least = max(least, -most)
    sizes = st.floats(-9, math.log10(most)).map(lambda exponent: min(10.0**exponent, most))
    signed = st.one_of(sizes, sizes.map(lambda size: max(-size, least)) if least < 0 else sizes)
    return st.one_of(st.sampled_from([0.0 if least <= 0 else least, most]), signed.map(lambda x: max(x, least)))


@st.composite
def vehicles(draw):
    gravity = draw(st.one_of(st.just(9.81), upto(MOST / 2, 0.0)))
    return Quadrotor(
        thrust_min=gravity * draw(st.floats(0.0, 1.0)),
        thrust_max=min(gravity + draw(upto(MOST, 1e-6)), MOST),
        rate_max=draw(st.one_of(st.just(10.0), upto(MOST, 1e-6))),
        gravity=gravity,
        radius=draw(st.sampled_from([0.0, 0.0, 0.1, 1e-6, 1e5])),
    )


@st.composite
def scenarios(draw):
    vehicle, near = draw(vehicles()), draw(st.floats(-3.0, 3.0))
    x, z = draw(upto(MOST / 2)), draw(upto(MOST / 2))
    goal = draw(st.sampled_from([(x + 1.0, z), (x, z - 1.0), (x + near, z + 2.0), (-9e5, 9e5)]))
    low, high = min(z, goal[1]), max(z, goal[1])
    floor, ceiling = draw(st.sampled_from([None, low, low - 1.0])), draw(st.sampled_from([None, high + 1e-3, high + 3]))
    places = st.tuples(st.one_of(st.just(x), upto(MOST), st.floats(x - 2, x + 2)), st.floats(low, high))
    gaps = upto(MOST, 1e-6).map(lambda gap: min(gap + 2.001 * vehicle.radius, MOST))
    hoops = draw(st.lists(st.tuples(places, gaps, upto(MOST)), max_size=8))
    dt = min(2 * math.pi / vehicle.rate_max * draw(st.one_of(st.floats(1e-9, 0.999), st.just(0.5))), 2e4)
    return Scenario(
        "any",
        (x, z),
        goal,
        hoops=tuple(Hoop(min(max(a, -MOST), MOST), b, gap, angle) for (a, b), gap, angle in hoops),
        floor=floor,
        ceiling=ceiling,
        quadrotor=vehicle,
        tolerance=Tolerance(draw(st.floats(1e-9, 0.99)), draw(upto(MOST, 1e-9)), draw(upto(MOST, 1e-9))),
        dt=dt,
        time_limit=dt * draw(st.integers(1, 30)),
    )


@st.composite
def distributions(draw):
    half = draw(upto(1e5, 0.2))
    fewest = draw(st.integers(0, 8))
    narrow = draw(upto(MOST, 1e-6))
    return Distribution(
        "any",
        half_width=half,
        least_distance=half * draw(st.floats(0.6, 1.0)),
        hoops=(fewest, draw(st.integers(fewest, 8))),
        aside=draw(st.floats(-5.0, 5.0)),
        turn=draw(st.floats(-3.0, 3.0)),
        diameter=(narrow, min(narrow * draw(st.floats(1.0, 1e3)), MOST)),
        time_limit=0.02 * draw(st.integers(1, 30)),
    )


disturbances = st.one_of(
    st.just({}),
    st.fixed_dictionaries(
        {},
        optional={
            "wind": upto(MOST, 0.0),
            "thrust_gain": st.floats(0.0, 0.999999),
            "mass": st.floats(0.0, 0.999999),
            "action_delay": st.integers(0, 50),
            "sensor_noise": upto(MOST, 0.0),
        },
    ),
)
state = st.lists(st.one_of(st.floats(-1e4, 1e4), st.floats(-5.0, 5.0)), min_size=5, max_size=5)
options = st.one_of(st.just({}), st.fixed_dictionaries({"state": state}), st.just({"hoops_passed": 0}))
finite = st.floats(allow_nan=False, allow_infinity=False)
pairs = st.one_of(
    st.tuples(finite, finite).map(np.array),
    st.tuples(*2 * [st.floats(width=32, allow_nan=False, allow_infinity=False)]).map(np.float32),
    st.tuples(*2 * [st.sampled_from([-1.0, 0.0, 1.0])]).map(np.array),
)


def fly(env, actions, **reset):
    """Fly one episode, checking each step; return the sum of the rewards and the last info."""
    observation, info = env.reset(**reset)
    total, ended, passed = 0.0, False, info["hoops_passed"]
    while not ended:
        assert info["outcome"] == "flying"
        assert env.observation_space.contains(observation)
        observation, reward, terminated, truncated, info = env.step(actions[info["steps"] % len(actions)])
        assert np.isfinite([reward, info["time"], *info["state"]]).all()
        assert passed <= info["hoops_passed"] <= len(env.scenario.hoops)
        total, passed, ended = total + reward, info["hoops_passed"], terminated or truncated
        assert ended == (info["outcome"] != "flying")
        assert (terminated, truncated) == (ended and info["outcome"] != "time-limit", info["outcome"] == "time-limit")
    assert env.observation_space.contains(observation)
    assert info["outcome"] in OUTCOMES[1:]
    assert info["is_success"] == (info["outcome"] == "goal")
    return total, info


@pytest.mark.parametrize("kind", [fleet_of, Fleet], ids=["compiled", "numpy"])
@fuzz(250)
@given(
    st.one_of(scenarios(), scenarios(), distributions()),
    disturbances,
    st.sampled_from(["sparse", "shaped"]),
    st.sampled_from(["features", "state"]),
    options,
    st.lists(pairs, min_size=1, max_size=5),
)
def test_any_scenario_flies_to_one_outcome(kind, problem, disturbed, reward, observation, start, actions):
    if isinstance(problem, Scenario):
        assert Scenario.from_json(problem.to_json()) == problem
    with patch("flatgym.env.fleet_of", kind):
        env = FlatQuadEnv(problem, reward, observation, **disturbed)
    for episode in range(2):
        total, info = fly(env, actions, seed=None if episode else 7, options=start)
        if reward == "sparse":
            paid = info["time"] if info["is_success"] else problem.max_steps * problem.dt
            assert math.isclose(-total, paid, rel_tol=1e-9)
