"""Fuzzing: for any scenario and actions no crash, no NaN, observations in their space, one outcome at the end.

Hypothesis searches extreme scenarios and actions. A seeded loop runs many ordinary ones with contacts of hoops, rims,
floors and goals. Invalid arguments are rejected by name.
"""

import json
import math
from dataclasses import fields, replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flatgym import DISTRIBUTIONS, OUTCOMES, SCENARIOS, Distribution, Disturbances, Hoop, Quadrotor, Scenario, Tolerance
from flatgym.envs.config import Starts
from flatgym.envs.env import FlatQuadEnv
from flatgym.envs.fleet_selection import make_fleet
from flatgym.envs.numpy_fleet import NumpyFleet
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.kernels import step

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
        thrust_max=min(gravity + draw(upto(MOST, 2e-6)), MOST),
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
    hoops = draw(st.lists(st.tuples(places, gaps, st.floats(-2 * math.pi, 2 * math.pi)), max_size=8))
    dt = min(2 * math.pi / vehicle.rate_max * draw(st.one_of(st.floats(1e-9, 0.999), st.just(0.5))), 2e4)
    return Scenario(
        "any",
        (x, z),
        goal,
        hoops=tuple(Hoop(min(max(a, -MOST), MOST), b, gap, angle) for (a, b), gap, angle in hoops),
        floor=floor,
        ceiling=ceiling,
        quadrotor=vehicle,
        tolerance=Tolerance(draw(st.floats(1e-9, 0.99)), draw(upto(MOST, 1e-9)), draw(upto(math.pi, 1e-9))),
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


@fuzz(250)
@given(
    st.sampled_from([make_fleet] * 9 + [NumpyFleet]),
    st.one_of(scenarios(), scenarios(), distributions()),
    disturbances,
    st.sampled_from(["sparse", "shaped"]),
    st.sampled_from(["features", "state"]),
    options,
    st.lists(pairs, min_size=1, max_size=5),
)
def test_every_episode_ends_with_one_outcome(kind, problem, disturbed, reward, observation, start, actions):
    if isinstance(problem, Scenario):
        assert Scenario.from_json(problem.to_json()) == problem
    with patch("flatgym.envs.env.make_fleet", kind):
        env = FlatQuadEnv(problem, reward, observation, **disturbed)
    for episode in range(2):
        total, info = fly(env, actions, seed=None if episode else 7, options=start)
        if reward == "sparse":
            paid = info["time"] if info["is_success"] else problem.max_steps * problem.dt
            assert math.isclose(-total, paid, rel_tol=1e-9)


# Ordinary scenarios, many of them


def ordinary(generator):
    """Draw a scenario in which much is met within few steps, or a distribution."""
    if generator.random() < 0.2:
        return replace(DISTRIBUTIONS["random-hoops"], half_width=3.1, time_limit=generator.uniform(0.1, 0.8))
    start = generator.uniform(-1, 1, 2)
    goal = start + generator.uniform([0.6, -1], [2.5, 1])
    low, high = min(start[1], goal[1]), max(start[1], goal[1])
    hoops = [
        Hoop(*generator.uniform([-1, low], [2.5, high]), generator.uniform(0.3, 2), generator.uniform(-6.2, 6.2))
        for _ in range(generator.integers(5))
    ]
    return Scenario(
        "ordinary",
        start,
        goal,
        hoops=hoops,
        floor=generator.choice([None, low - generator.random()]),
        ceiling=generator.choice([None, high + generator.random() + 0.01]),
        quadrotor=Quadrotor(
            generator.uniform(0, 9),
            generator.uniform(10, 40),
            generator.uniform(1, 20),
            9.81,
            generator.choice([0.0, 0.1]),
        ),
        tolerance=Tolerance(*generator.uniform([0.05, 0.1, 0.1], [0.5, 8, 3.1])),
        dt=generator.uniform(0.005, 0.25),
        time_limit=generator.uniform(0.3, 2),
    )


def any_disturbances(generator):
    strengths = {"wind": 5.0, "thrust_gain": 0.5, "mass": 0.5, "action_delay": 4, "sensor_noise": 0.3}
    return {name: most for name, most in strengths.items() if generator.random() < 0.3}


def pool(problem, generator):
    """Starts near what a scenario names."""
    if isinstance(problem, Distribution):
        return None
    points = np.array([problem.start, problem.goal, *((hoop.x, hoop.z) for hoop in problem.hoops)])
    state = generator.normal(0, [0.3, 0.3, 2, 2, 1], (100, 5))
    state[:, 0:2] += points[generator.integers(len(points), size=100)]
    return Starts(state, generator.integers(0, len(problem.hoops) + 1, 100), share=generator.choice([0.0, 0.7]))


class Tally:
    """What n flights have got in their present episodes, and how all before them ended."""

    def __init__(self, envs, infos):
        self.envs, self.limit = envs, envs.scenario.max_steps * envs.scenario.dt
        self.total, self.met = np.zeros(envs.num_envs), np.zeros(len(OUTCOMES), dtype=int)
        self.passed, self.hoops = infos["hoops_passed"], 0

    def add(self, observation, reward, terminated, truncated, infos):
        """Check a step in SAME_STEP mode."""
        assert self.envs.observation_space.contains(observation)
        assert np.isfinite(reward).all()
        assert np.isfinite(infos["state"]).all()
        ended = terminated | truncated
        assert not (terminated & truncated).any()
        assert np.all(infos["outcome"] == "flying")
        self.total += reward
        now = infos["hoops_passed"]
        if ended.any():
            self.end(ended, truncated, infos["final_obs"], infos["final_info"])
            now = np.where(ended, infos["final_info"]["hoops_passed"], now)
        assert np.all(now >= self.passed)
        self.hoops += int((now - self.passed).sum())
        self.passed, self.total[ended] = infos["hoops_passed"], 0.0

    def end(self, ended, truncated, observations, final):
        space, words = self.envs.single_observation_space, final["outcome"][ended]
        assert all(space.contains(observation) for observation in observations[ended])
        np.testing.assert_array_equal(words == "time-limit", truncated[ended])
        np.testing.assert_array_equal(final["is_success"][ended], words == "goal")
        self.met += [int(np.sum(words == word)) for word in OUTCOMES]
        if self.envs.config.reward == "sparse":
            paid = np.where(words == "goal", final["time"][ended], self.limit)
            np.testing.assert_allclose(-self.total[ended], paid, rtol=1e-9)


def variants():
    return sum(len(getattr(one, "signatures", ())) for one in vars(step).values())


def test_half_a_million_steps_through_random_scenarios():
    generator, n, steps = np.random.default_rng(0), 64, 40
    met, hoops, flown, compiled = np.zeros(len(OUTCOMES), dtype=int), 0, 0, set()
    for seed in range(250):
        problem = ordinary(generator)
        words = {
            "reward": generator.choice(["sparse", "shaped"]),
            "observation": generator.choice(["features", "state"]),
        }
        envs = FlatQuadVectorEnv(
            n,
            problem,
            **words,
            **any_disturbances(generator),
            starts=pool(problem, generator),
            autoreset_mode="SameStep",
        )
        tally = Tally(envs, envs.reset(seed=seed)[1])
        for i in range(steps):
            if i % 4 == 0:
                actions = generator.uniform(-1.5, 1.5, (n, 2)) * generator.choice([1.0, 1e300], (n, 1), p=[0.9, 0.1])
            tally.add(*envs.step(actions))
            flown += n
        met, hoops = met + tally.met, hoops + tally.hoops
        compiled.add(variants())
    assert met[0] == 0
    assert np.all(met[1:] > 100), dict(zip(OUTCOMES, met, strict=True))
    assert hoops > 1000
    assert flown >= 500_000
    assert len(compiled) == 1  # a new scenario compiles nothing


# Whatever else is handed over

whole = st.integers(-1000, 1000)
junk = st.recursive(
    st.one_of(st.none(), st.booleans(), whole, st.floats(), st.text(max_size=5), st.binary(max_size=2), st.just(1j)),
    lambda parts: st.one_of(st.lists(parts, max_size=6), st.dictionaries(st.text(max_size=2), parts, max_size=2)),
    max_leaves=6,
)
plain = SCENARIOS["hoop"]
OWNERS = {
    "FlatQuadEnv": (
        FlatQuadEnv,
        {},
        ["scenario", "reward", "observation", *Disturbances().__dict__, "starts", "ghost", "render_mode"],
    ),
    "FlatQuadVectorEnv": (FlatQuadVectorEnv, {}, ["num_envs", "autoreset_mode", "max_episode_steps", "starts"]),
    "Starts": (Starts, {"state": np.zeros((2, 5))}, ["state", "hoops_passed", "share"]),
    **{
        type(whole).__name__: (
            type(whole),
            {one.name: getattr(whole, one.name) for one in fields(whole)},
            [one.name for one in fields(whole)],
        )
        for whole in (plain, plain.hoops[0], plain.quadrotor, plain.tolerance, DISTRIBUTIONS["random-hoops"])
    },
}


def refusal(call, kinds=ValueError):
    """Return the words with which a call is refused, or none."""
    try:
        call()
    except kinds as error:
        return str(error)
    return ""


def try_out(env):
    env.reset(seed=0)
    env.step(env.action_space.sample())


@pytest.mark.parametrize("owner", OWNERS)
@fuzz(300)
@given(st.data())
def test_rejected_calls_are_named(owner, data):
    make, others, names = OWNERS[owner]
    name = data.draw(st.sampled_from(names))
    value = data.draw(st.one_of(junk, st.integers(-(10**400), 10**400)) if name != "num_envs" else junk)
    kinds = (ValueError, TypeError) if name == "scenario" else ValueError  # TypeError for what is no word at all
    words = refusal(lambda: make(**others | {name: value}), kinds)
    assert not words or name.split("_")[0] in words
    if not words and owner.startswith("FlatQuad"):
        try_out(make(**others | {name: value}))


@fuzz(300)
@given(st.dictionaries(st.sampled_from([field.name for field in fields(Scenario)]), junk), st.integers(0, 200))
def test_a_text_is_a_scenario_or_rejected(changes, cut):
    text = json.dumps(plain.to_dict() | changes, default=str)
    for one in (text, text[: len(text) - cut]):
        words = refusal(lambda one=one: Scenario.from_json(one))
        assert not words or any(owner in words for owner in ("not a scenario", *OWNERS))


@pytest.mark.parametrize("make", [FlatQuadEnv, lambda: FlatQuadVectorEnv(2)], ids=["scalar", "batched"])
@fuzz(200)
@given(st.sampled_from(["seed", "options", "state", "hoops_passed", "reset_mask", "actions"]), junk)
def test_a_rejected_call_changes_nothing(make, name, value):
    env, twin = make(), make()
    for one in (env, twin):
        one.reset(seed=0)
    calls = {
        "seed": lambda: env.reset(seed=value),
        "options": lambda: env.reset(options=value),
        "actions": lambda: env.step(value),
    }
    if words := refusal(calls.get(name, lambda: env.reset(options={name: value}))):
        assert name in words
        np.testing.assert_array_equal(env.step(env.action_space.low)[0], twin.step(env.action_space.low)[0])
