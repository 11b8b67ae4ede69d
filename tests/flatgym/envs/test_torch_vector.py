"""The batch of tensors repeats the scalar environment, in every autoreset mode, and tells bad input."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, VectorWrapper
from gymnasium.wrappers.vector import ArrayConversion

from flatgym import OUTCOMES, Distribution, Hoop, Quadrotor, Scenario, Tolerance, reference
from flatgym.envs.torch_vector import FlatQuadTorchVectorEnv
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.testing import check_vector_env

EVERYTHING = {"wind": 2.0, "thrust_gain": 0.1, "mass": 0.1, "action_delay": 3, "sensor_noise": 0.01}
EASY = {
    "floor": -2.0,
    "ceiling": 4.0,
    "tolerance": Tolerance(0.5, 5.0, 1.0),
    "hoops": (Hoop(0.3, 0.2, 1.0), Hoop(0.6, 0.4, 1.0)),
    "time_limit": 0.24,
}
NEAR = Scenario("near", (0, 0), (1, 0.5), **EASY)
BODY = Scenario("body", (0, 0), (1, 0.5), quadrotor=Quadrotor(radius=0.1), **EASY)


TRACKS = Distribution("tracks", hoops=(1, 3), leg=(2.0, 3.0), least_distance=1.5, time_limit=0.24)


def single(scenario, **options):
    return gym.make("FlatQuad-v0", scenario=scenario, **options).unwrapped


class AsNumPy(VectorWrapper):
    """The results as `FlatQuadVectorEnv` returns them: NumPy, outcomes as words, final observations as objects."""

    def __init__(self, envs):
        super().__init__(ArrayConversion(envs, env_xp=torch, target_xp=np))

    def reset(self, **arguments):
        observations, infos = self.env.reset(**arguments)
        return np.array(observations), named(infos)

    def step(self, actions):
        *results, infos = (value if isinstance(value, dict) else np.array(value) for value in self.env.step(actions))
        return *results, named(infos)


def named(infos):
    infos = {key: named(value) if isinstance(value, dict) else np.array(value) for key, value in infos.items()}
    if "outcome" in infos:
        words = np.array(OUTCOMES, dtype=object)[infos["outcome"]]
        infos["outcome"] = np.where(infos["_outcome"], words, None)
    if "final_obs" in infos:
        rows = [row if ended else None for row, ended in zip(infos["final_obs"], infos["_final_obs"], strict=True)]
        infos["final_obs"] = np.empty(len(rows), dtype=object)
        infos["final_obs"][:] = rows
    return infos


@pytest.mark.parametrize(
    ("scenario", "mode"),
    [
        (NEAR, AutoresetMode.NEXT_STEP),
        (BODY, AutoresetMode.SAME_STEP),
        (TRACKS, AutoresetMode.SAME_STEP),
        (TRACKS, AutoresetMode.DISABLED),
    ],
)
def test_it_repeats_the_scalar_environment(scenario, mode):
    envs = FlatQuadTorchVectorEnv(2, scenario, autoreset_mode=mode, dtype=torch.float64)
    assert check_vector_env(AsNumPy(envs), lambda: single(scenario), steps=27) >= 2


def test_it_repeats_the_scalar_environment_with_all_disturbances():
    options = {"reward": "sparse", "observation": "state", **EVERYTHING}
    envs = FlatQuadTorchVectorEnv(2, NEAR, **options, dtype=torch.float64)
    assert check_vector_env(AsNumPy(envs), lambda: single(NEAR, **options), steps=27) >= 2


def test_k_star_of_the_first_episodes_is_known_and_of_later_ones_of_named_scenarios():
    envs = FlatQuadTorchVectorEnv(2, "hoop", autoreset_mode="SameStep", max_episode_steps=2)
    assert envs.reset(seed=0)[1]["k_star"].tolist() == [reference("hoop").k_star] * 2
    envs.step(torch.zeros(2, 2))
    *_, truncated, infos = envs.step(torch.zeros(2, 2))
    assert truncated.all()
    assert infos["k_star"].tolist() == infos["final_info"]["k_star"].tolist() == [reference("hoop").k_star] * 2
    assert envs.reset(options={"state": [1.0, 1, 0, 0, 0]})[1]["k_star"].tolist() == [0, 0]
    drawn = FlatQuadTorchVectorEnv(2, "random-goal")
    scalar = gym.make("FlatQuad-v0", scenario="random-goal").reset(seed=EVALUATION_SEED)[1]
    assert drawn.reset(seed=EVALUATION_SEED)[1]["k_star"][0].item() == scalar["k_star"] > 0


def test_starts_may_be_requested_and_wrong_ones_change_nothing():
    envs = FlatQuadTorchVectorEnv(2, "slalom", dtype=torch.float64)
    envs.reset(seed=3)
    state = torch.tensor([[1.0, 0, 1, 0, 0], [2, 0, 0, 1, 0]], dtype=torch.float64)
    infos = envs.reset(options={"state": state, "hoops_passed": 2, "reset_mask": np.array([True, False])})[1]
    assert infos["state"].tolist() == [[1, 0, 1, 0, 0], [0, 0, 0, 0, 0]]
    assert infos["hoops_passed"].tolist() == [2, 0]
    with pytest.raises(ValueError, match=r"must lie in 0\.\.3, got 4"):
        envs.reset(options={"hoops_passed": 4})
    again = envs.step(torch.zeros(2, 2))[4]
    assert again["steps"].tolist() == [1, 1]
    assert again["hoops_passed"].tolist() == [2, 0]


def test_single_precision_is_the_default_and_close():
    single, double = (FlatQuadTorchVectorEnv(50, "random-hoops", dtype=kind) for kind in (torch.float32, torch.float64))
    assert single.reset(seed=0)[0].dtype == torch.float32
    double.reset(seed=0)
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        actions = 2 * torch.rand(50, 2, generator=generator) - 1
        near, exact = single.step(actions), double.step(actions)
        assert near[4]["state"].dtype == near[1].dtype == torch.float32
        torch.testing.assert_close(near[4]["state"].double(), exact[4]["state"], atol=1e-4, rtol=0)
        assert torch.equal(near[4]["outcome"], exact[4]["outcome"])


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_an_action_that_is_not_finite_ends_its_episode_out_of_bounds(wrong):
    envs = FlatQuadTorchVectorEnv(2, "hoop", autoreset_mode="SameStep")
    envs.reset(seed=0)
    envs.step(torch.zeros(2, 2))
    observations, rewards, terminated, truncated, infos = envs.step(torch.tensor([[0.0, wrong], [0.0, 0.0]]))
    assert terminated.tolist() == [True, False]
    assert not truncated.any()
    assert OUTCOMES[infos["final_info"]["outcome"][0]] == "out-of-bounds"
    assert torch.isfinite(observations).all()
    assert torch.isfinite(infos["final_obs"]).all()
    assert torch.isfinite(rewards).all()


def test_bad_input_is_told():
    envs = FlatQuadTorchVectorEnv(2, "hoop")
    with pytest.raises(gym.error.ResetNeeded, match="before the first"):
        envs.step(torch.zeros(2, 2))
    envs.reset(seed=0)
    with pytest.raises(TypeError, match=r"got float64 of numpy; torch\.as_tensor"):
        envs.step(np.zeros((2, 2)))
    with pytest.raises(TypeError, match=r"floating point numbers, got torch\.int64"):
        envs.step(torch.zeros(2, 2, dtype=torch.int64))
    with pytest.raises(ValueError, match=r"shape \(2, 2\), got \(3, 2\)"):
        envs.step(torch.zeros(3, 2))
    with pytest.raises(ValueError, match="must be on cpu, got meta"):
        envs.step(torch.zeros(2, 2, device="meta"))
    with pytest.raises(ValueError, match=r"dtype must be torch\.float32 or torch\.float64, got torch\.float16"):
        FlatQuadTorchVectorEnv(2, "hoop", dtype=torch.float16)
    with pytest.raises(ValueError, match="num_envs must be at least 1"):
        FlatQuadTorchVectorEnv(0)
