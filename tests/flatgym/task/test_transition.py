"""Transition and reward: hoops in order, outcomes, tolerance, shaping that keeps the optimal policy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from flatgym import OBSERVATION_NAMES, OUTCOMES, SCENARIOS, Hoop, Quadrotor, Scenario, task
from flatgym.task import shaping
from flatgym.task.scene import FLYING, EpisodeState, Scene


def episode(scene, state, passed=0, steps=0):
    n = len(scene)
    return EpisodeState(
        state=np.tile(np.asarray(state, dtype=float), (n, 1)),
        steps=np.full(n, steps),
        hoops_passed=np.full(n, passed),
        outcome=np.zeros(n, dtype=np.int64),
    )


def after_one_step(scenario, state, passed=0, steps=0, control=(9.81, 0.0)):
    scene = Scene.of([scenario])
    return task.advance(scene, episode(scene, state, passed, steps), np.array([control]))


FREE = Scenario("free", (0, 0), (6, 0), hoops=(Hoop(1, 0, 0.5), Hoop(1.05, 0, 0.5)))


@pytest.mark.parametrize(
    ("state", "passed", "expected"),
    [
        ([0.9, 0.0, 10, 0, 0], 0, 2),  # both hoops within one step
        ([0.9, 0.0, 6, 0, 0], 0, 1),  # only the first
        ([1.1, 0.0, -10, 0, 0], 0, 0),  # against the direction
        ([0.9, 0.26, 10, 0, 0], 0, 0),  # past the gap
        ([0.9, 0.24, 10, 0, 0], 0, 2),
        ([1.02, 0.0, 6, 0, 0], 0, 0),  # the second hoop does not count before the first
        ([1.02, 0.0, 6, 0, 0], 1, 2),
    ],
)
def test_hoops_count_in_order_and_in_their_direction(state, passed, expected):
    assert after_one_step(FREE, state, passed).hoops_passed[0] == expected


def test_the_crossing_is_found_on_the_arc_not_on_the_chord():
    # The line is reached in the middle of the step, where the falling arc is above its chord.
    scenario = Scenario("bow", (0, 0), (6, 0), hoops=(Hoop(1, 0, 0.02),), dt=0.2)
    state = [0.0, 0.0, 10.0, 0.0, 0.0]
    control = (1.0, 0.0)
    fall = (9.81 - 1.0) * 0.1**2 / 2
    hit = replace(scenario, hoops=(Hoop(1, -fall, 0.02),))
    missed = replace(scenario, hoops=(Hoop(1, -(9.81 - 1.0) * 0.2**2 / 4, 0.02),))
    assert after_one_step(hit, state, control=control).hoops_passed[0] == 1
    assert after_one_step(missed, state, control=control).hoops_passed[0] == 0


def test_only_a_body_with_a_radius_collides_with_rims():
    wide = replace(FREE, quadrotor=Quadrotor(radius=0.1))
    for offset, outcome, passed in ((0.1, "flying", 2), (0.17, "collision", 0), (0.5, "flying", 0)):
        after = after_one_step(wide, [0.9, offset, 10, 0, 0])
        assert (OUTCOMES[after.outcome[0]], after.hoops_passed[0]) == (outcome, passed)
    assert OUTCOMES[after_one_step(FREE, [0.9, 0.17, 10, 0, 0]).outcome[0]] == "flying"


GROUND = replace(SCENARIOS["ground-6"], ceiling=3.0)


@pytest.mark.parametrize(
    ("state", "steps", "outcome"),
    [
        ([6.05, 0.05, 0.1, 0.1, 0.05], 0, "goal"),
        ([6.05, 0.05, 0.1, 0.1, 0.05 + 4 * np.pi], 0, "goal"),
        ([6.0, 0.1, 0, 0, np.pi], 0, "flying"),  # arriving inverted is not arriving
        ([6.08, 0.08, 0, 0, 0], 0, "flying"),  # inside the box, outside the circle
        ([6.0, 0.05, 0.25, 0, 0], 0, "flying"),
        ([3.0, 0.05, 0, -5, 0], 0, "floor"),
        ([3.0, 2.95, 0, 5, 0], 0, "ceiling"),
        ([10.99, 1.0, 5, 0, 0], 0, "out-of-bounds"),
        ([3.0, 1.0, 0, 0, 0], 249, "time-limit"),
        ([6.0, 0.05, 0, 0, 0], 249, "goal"),  # in the last step is in time
    ],
)
def test_outcomes(state, steps, outcome):
    after = after_one_step(GROUND, state, steps=steps)
    assert OUTCOMES[after.outcome[0]] == outcome
    assert after.truncated[0] == (outcome == "time-limit")
    assert after.terminated[0] == (outcome not in ("flying", "time-limit"))


def test_a_dip_below_the_floor_inside_a_step_counts():
    # Down at 0.5 m/s from 3 mm, braked hard: above the floor at both ends of the step, not between.
    after = after_one_step(GROUND, [3.0, 0.003, 0, -0.098, 0.0], control=(20.0, 0.0))
    assert after.state[0, 1] > 0.003
    assert OUTCOMES[after.outcome[0]] == "flying"
    after = after_one_step(replace(GROUND, dt=0.1), [3.0, 0.003, 0, -0.5, 0.0], control=(20.0, 0.0))
    assert after.state[0, 1] > 0.0
    assert OUTCOMES[after.outcome[0]] == "floor"


def test_standing_on_the_floor_is_allowed():
    after = after_one_step(GROUND, GROUND.start_state, control=(9.81, 0.0))
    assert OUTCOMES[after.outcome[0]] == "flying"


def fly_randomly(scene, generator, steps=300):
    """Fly until all have ended; return the situations in order."""
    flown = [task.initial(scene)]
    for _ in range(steps):
        control = generator.uniform(scene.quadrotor.control_low, scene.quadrotor.control_high, (len(scene), 2))
        after = task.advance(scene, flown[-1], control)
        flown.append(after.put(flown[-1].outcome != FLYING, flown[-1]))
    return flown


def test_returns_are_minus_the_time_and_shaping_adds_a_constant(generator):
    scene = Scene.of([replace(SCENARIOS["hoop"], time_limit=1.0)] * 50)
    flown = fly_randomly(scene, generator, 60)
    sparse, shaped = np.zeros(50), np.zeros(50)
    for before, after in pairwise(flown):
        live = before.outcome == FLYING
        sparse += np.where(live, task.reward(scene, before, after, shaped=False), 0)
        shaped += np.where(live, task.reward(scene, before, after, shaped=True), 0)
    assert {OUTCOMES[code] for code in flown[-1].outcome} <= {"out-of-bounds", "time-limit"}
    np.testing.assert_allclose(sparse, -1.0, atol=1e-12)
    ended = flown[-1].terminated
    start = shaping.potential(scene, flown[0])
    np.testing.assert_allclose((shaped - sparse)[ended], -start[ended], atol=1e-12)
    rest = shaping.potential(scene, flown[-1])
    np.testing.assert_allclose(shaped - sparse, rest - start, atol=1e-12)


@pytest.mark.parametrize("name", SCENARIOS)
def test_observations_are_finite_and_bounded(name, generator):
    scene = Scene.of([SCENARIOS[name]] * 20)
    for flown in fly_randomly(scene, generator, 40):
        observation = task.observe(scene, flown)
        assert observation.dtype == np.float32
        assert observation.shape == (20, len(OBSERVATION_NAMES))
        assert np.all(np.abs(observation) <= 1)


def test_scenarios_of_a_scene_share_the_vehicle():
    with pytest.raises(ValueError, match=r"must share dt: 'hoop' has 0\.02, 'hoop' has 0\.01"):
        Scene.of([SCENARIOS["hoop"], replace(SCENARIOS["hoop"], dt=0.01)])


def test_a_line_crossed_beside_the_gap_may_be_crossed_again_through_it(generator):
    # Within one step of half a second, turning nearly a whole turn: the gap is put where the second crossing is.
    quadrotor, count, dt = Quadrotor(rate_max=12.0, thrust_max=30.0), 10_000, 0.5
    angle, point = generator.uniform(-np.pi, np.pi, count), generator.normal(0, 0.15, (count, 2))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    state = generator.normal(0, [0.05, 0.05, 2.0, 2.0, 2.0], (count, 5))
    control = np.stack([generator.uniform(20, 30, count), 12 * np.sign(generator.normal(size=count))], axis=-1)
    positions = quadrotor.step(state[:, None], control[:, None], np.linspace(0, dt, 801))[:, :, 0:2]
    along = np.einsum("nti,ni->nt", positions - point[:, None], direction)
    rises = (along[:, :-1] < 0) & (along[:, 1:] >= 0)
    twice = np.flatnonzero(rises.sum(axis=1) == 2)
    first, second = (positions[twice, np.nonzero(rises[twice])[1][i::2] + 1] for i in (0, 1))
    chosen = np.hypot(*(first - second).T) > 0.1
    twice, second = twice[chosen], second[chosen]
    centre = second - np.einsum("ni,ni->n", second - point[twice], direction[twice])[:, None] * direction[twice]
    wall = Scenario("wall", (0, 0), (9, 9), hoops=(Hoop(0, 0, 0.1),), quadrotor=quadrotor, dt=dt)
    scene = Scene.of([wall]).repeat(len(twice))
    scene = replace(scene, hoop_centre=centre[:, None], hoop_direction=direction[twice, None])
    zeros = np.zeros(len(twice), dtype=np.int64)
    after = task.advance(scene, EpisodeState(state[twice], zeros, zeros, zeros), control[twice])
    assert len(twice) > 20
    np.testing.assert_array_equal(after.hoops_passed, 1)
