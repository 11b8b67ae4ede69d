"""The potential: the double integrator's time to go, bounded in its change, with the detour through hoops."""

from dataclasses import replace

import numpy as np

from flatgym import SCENARIOS, Scenario, task
from flatgym.task.scene import Scene
from flatgym.task.shaping import potential, remaining_path_length, rest_time
from optimal.flights.projection_bound import projection_bound


def test_rest_time_brings_a_double_integrator_to_rest(generator):
    offset, speed = generator.normal(0, 5, 200), generator.normal(0, 5, 200)
    forward, backward = generator.uniform(1, 20, (2, 200))
    time = rest_time(offset, speed, forward, backward)
    # Of all flights that push one way until some moment and the other way after, the one that stops at the
    # offset takes that time.
    switch = np.linspace(0, 1, 20001)[:, None] * time
    reached = []
    for first, second in ((forward, -backward), (-backward, forward)):
        top = speed + first * switch
        left = time - switch
        stops = np.abs(top + second * left)
        ends = np.abs(speed * switch + first * switch**2 / 2 + top * left + second * left**2 / 2 - offset)
        reached.append((stops + ends).min(axis=0))
    assert np.min(reached, axis=0).max() < 0.02


def test_the_time_to_go_from_rest_is_the_projection_bound():
    scenario = Scenario("across", (0, 0), (4, 4))
    scene = Scene.of([scenario])
    rough = -potential(scene, task.initial(scene))[0]
    exact = projection_bound(scenario)
    assert 0.95 * exact < rough <= exact


def test_the_potential_rises_by_at_most_the_elapsed_time(generator):
    scene = Scene.of([replace(SCENARIOS["horizontal-6"], time_limit=10.0)] * 300)
    episode = replace(task.initial(scene), state=generator.normal(0, [3, 3, 4, 4, 2], (300, 5)))
    for _ in range(50):
        control = generator.uniform(scene.quadrotor.control_low, scene.quadrotor.control_high, (300, 2))
        after = task.advance(scene, episode, control)
        flying = ~after.terminated & ~episode.terminated
        gain = (potential(scene, after) - potential(scene, episode))[flying]
        assert np.all(gain <= scene.dt + 1e-9)
        episode = after


def test_hoops_ahead_lengthen_the_remaining_path():
    scene = Scene.of([SCENARIOS["slalom"]] * 4)
    episode = replace(task.initial(scene), hoops_passed=np.arange(4))
    way = remaining_path_length(scene, episode)
    assert np.all(np.diff(way) < 0)
    assert way[3] == 9.0
    legs = np.array([[0, 0], [2.5, 1.5], [5, -1.5], [7.5, 1.5], [9, 0]])
    np.testing.assert_allclose(way[0], np.hypot(*np.diff(legs, axis=0).T).sum())
