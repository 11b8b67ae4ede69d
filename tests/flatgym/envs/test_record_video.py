"""Gymnasium's RecordVideo records the environment; `tests.conftest` stands in for moviepy."""

import gymnasium as gym
import imageio.v3 as imageio
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo

from flatgym.scenarios.reference import reference


@pytest.mark.usefixtures("moviepy")
def test_record_video_records_every_frame(tmp_path):
    env = gym.make("FlatQuad-v0", scenario="horizontal-3", render_mode="rgb_array", ghost=True)
    env = RecordVideo(env, str(tmp_path / "films"), episode_trigger=lambda episode: episode == 0, disable_logger=True)
    actions = reference("horizontal-3").actions
    for _ in range(2):
        env.reset(seed=0)
        for action in actions:
            *_, info = env.step(action)
        assert info["outcome"] == "goal"
    env.close()
    (recorder,) = (tmp_path / "films").glob("*.gif")
    frames = imageio.imread(recorder)
    assert frames.shape[:3] == (len(actions) + 1, 720, 960)
    assert np.any(frames[0] != frames[-1])
