"""Recorded episodes are drawn as the renderer draws them from states and thrusts."""

from dataclasses import replace

import numpy as np
import pytest

from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.envs.env import FlatQuadEnv
from flatgym.rendering import Renderer, load_pygame
from flatgym.rendering.recorder import EpisodeRecorder
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import OUTCOMES

SIZE = (320, 240)
HOOP = SCENARIOS["hoop"]


def infos(scenario, actions):
    """Return the infos of an episode from reset on."""
    return [
        {
            "state": episode.state[0],
            "hoops_passed": int(episode.hoops_passed[0]),
            "outcome": OUTCOMES[episode.outcome[0]],
        }
        for episode in fly_actions(scenario, actions)
    ]


def recorded(recorder, scenario, actions):
    """Return the picture after the actions."""
    first, *others = infos(scenario, actions)
    recorder.start(first)
    for action, info in zip(actions, others, strict=True):
        recorder.add(float(action[0]), info)
    return recorder.draw(scenario)


@pytest.mark.parametrize("ghost", [False, True])
def test_a_recorded_episode_is_drawn_as_by_the_renderer(ghost):
    actions = reference("hoop").actions
    recorder = EpisodeRecorder(HOOP, "rgb_array", ghost=ghost, size=SIZE)
    recorded(recorder, HOOP, actions[:9])
    pixels = recorded(recorder, HOOP, actions)
    renderer = Renderer(HOOP, size=SIZE, k_star=70, ghost=ghost_states("hoop") if ghost else None)
    assert np.array_equal(pixels, renderer.draw(ghost_states("hoop"), HOOP.quadrotor.control(actions)[:, 0], 1, "goal"))


def test_a_ghost_can_be_any_trajectory():
    actions = reference("hoop").actions[:20]
    slow = np.repeat(ghost_states("hoop"), 2, axis=0)
    pictures = [
        recorded(EpisodeRecorder(HOOP, "rgb_array", ghost=g, size=SIZE), HOOP, actions) for g in (False, True, slow)
    ]
    assert (pictures[0] != pictures[1]).any()
    assert (pictures[1] != pictures[2]).any()


def test_the_thrust_of_clipped_actions_is_drawn():
    pictures = []
    for action in ([1.0, 0.0], [7.0, 0.0]):
        env = FlatQuadEnv(render_mode="rgb_array")
        env.reset(seed=0)
        for _ in range(5):
            env.step(np.array(action))
        pictures.append(env.render())
    assert np.array_equal(*pictures)


def test_each_episode_of_a_distribution_is_drawn_in_its_scenario():
    distribution, recorder = (
        DISTRIBUTIONS["random-goal"],
        EpisodeRecorder(DISTRIBUTIONS["random-goal"], "rgb_array", size=SIZE),
    )
    pictures = [recorded(recorder, distribution.scenario(1, episode), np.zeros((3, 2))) for episode in (0, 1, 0)]
    assert (pictures[0] != pictures[1]).any()
    assert np.array_equal(pictures[0], pictures[2])


def test_k_star_is_shown_for_comparable_episodes_only():
    recorder = EpisodeRecorder(HOOP, "rgb_array", size=SIZE)
    information = infos(HOOP, [])[0]
    reported = recorded(recorder, HOOP, [])
    disturbed = recorded(EpisodeRecorder(HOOP, "rgb_array", scored=False, size=SIZE), HOOP, [])
    recorder.start(information | {"state": HOOP.start_state + 1e-9 * np.eye(5)[2]})
    assert np.array_equal(recorder.draw(HOOP), disturbed)
    assert (reported != disturbed).any()
    recorder.start(information | {"hoops_passed": 1})
    ahead = recorder.draw(HOOP)
    assert np.array_equal(ahead[:26, -60:], disturbed[:26, -60:])


def test_without_a_mode_nothing_is_recorded():
    env = FlatQuadEnv()
    env.reset()
    env.step(np.zeros(2))
    assert env.render() is None
    assert vars(env.recorder)["_states"] == []
    env.close()
    with pytest.raises(RuntimeError, match="no pictures without a render_mode"):
        env.recorder.draw(HOOP)


def test_a_window_shows_each_step(monkeypatch):
    load_pygame()
    import pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.quit()
    env = FlatQuadEnv(render_mode="human")
    env.recorder.size = SIZE
    begin = pygame.time.get_ticks()
    for _ in range(2):
        env.reset()
        for action in reference("hoop").actions[:5]:
            env.step(action)
        assert env.render() is None
        env.close()  # the next reset opens the window again
    assert pygame.time.get_ticks() - begin >= 2 * 5 * 20
    env.close()
    pygame.display.quit()


def test_invalid_recordings_are_named():
    with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
        EpisodeRecorder(HOOP, "rgb_array").draw(HOOP)
    with pytest.raises(ValueError, match="unknown render_mode 'ascii'"):
        EpisodeRecorder(HOOP, "ascii")
    for problem in (replace(HOOP, dt=0.01), DISTRIBUTIONS["random-hoops"]):
        with pytest.raises(ValueError, match=r"no K\*-step solution is stored for .* give states"):
            EpisodeRecorder(problem, "rgb_array", ghost=True)
    with pytest.raises(ValueError, match=r"shape \(K\+1, 5\), got shape \(3,\)"):
        EpisodeRecorder(HOOP, "rgb_array", ghost=[1, 2, 3])
