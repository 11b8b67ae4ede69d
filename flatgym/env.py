"""FlatQuad-v0, one vehicle at a time: a thin Gymnasium shell around the verbs of `task`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym import catalogue, task
from flatgym.catalogue import DEFAULT_SCENARIO, ScenarioLike
from flatgym.quadrotor import Array
from flatgym.scene import FLYING, OUTCOMES, Scene, Situation
from flatgym.task import OBSERVATION_NAMES

Observation = NDArray[np.float32]

REWARDS = ("shaped", "sparse")
RESET_OPTIONS = ("state", "hoops_passed")


def observation_space() -> gym.Space[Any]:
    """The space of one observation, named by OBSERVATION_NAMES."""
    return gym.spaces.Box(-1.0, 1.0, (len(OBSERVATION_NAMES),), np.float32)


def action_space() -> gym.Space[Any]:
    """The space of one action: thrust and rate, scaled to [-1, 1]."""
    return gym.spaces.Box(-1.0, 1.0, (2,), np.float32)


def check_reward(reward: str) -> bool:
    """Return whether the reward is shaped; a ValueError lists the known rewards."""
    if reward not in REWARDS:
        raise ValueError(f"unknown reward {reward!r}; known: {', '.join(REWARDS)}")
    return reward == "shaped"


def check_actions(actions: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return actions as floats clipped to [-1, 1]; a ValueError for a wrong shape, NaN or infinity."""
    values = np.asarray(actions, dtype=np.float64)
    if values.shape != shape:
        raise ValueError(f"actions must have shape {shape}, got {values.shape}")
    if not np.isfinite(values).all():
        where = [tuple(map(int, index)) for index in np.argwhere(~np.isfinite(values))[:5]]
        raise ValueError(f"actions must be finite, got {values[~np.isfinite(values)][:5]} at indices {where}")
    return np.clip(values, -1.0, 1.0)


def check_state(state: ArrayLike) -> Array:
    """Return a start state as floats, shape (5,); a ValueError for anything else."""
    values = np.asarray(state, dtype=np.float64)
    if values.shape != (5,) or not np.isfinite(values).all():
        raise ValueError(f"options['state'] must be five finite numbers [x, z, vx, vz, theta], got {state!r}")
    return values


def begin(scene: Scene, options: dict[str, Any] | None) -> Situation:
    """Return the initial situation of one vehicle, with the reset options applied."""
    options = options or {}
    unknown = set(options) - set(RESET_OPTIONS)
    if unknown:
        raise ValueError(f"unknown reset options {sorted(unknown)}; known: {', '.join(RESET_OPTIONS)}")
    situation = task.initial(scene)
    state, passed = situation.state, situation.hoops_passed
    if "state" in options:
        state = check_state(options["state"])[None]
    if "hoops_passed" in options:
        count = options["hoops_passed"]
        if count not in range(int(scene.hoop_count[0]) + 1):
            raise ValueError(f"options['hoops_passed'] must lie in 0..{scene.hoop_count[0]}, got {count!r}")
        passed = np.array([count])
    return Situation(state=state, steps=situation.steps, hoops_passed=passed, outcome=situation.outcome)


class FlatQuadEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Fly a planar quadrotor from rest to rest, through hoops, in as few steps as possible.

    ## Action space
    `Box(-1, 1, (2,), float32)`; finite actions beyond the box are clipped, as in Gymnasium's own
    continuous environments. The control is held for one step of `scenario.dt`.

    | # | action | -1 | +1 |
    |---|--------|----|----|
    | 0 | thrust | `thrust_min` = 1 m/s^2 | `thrust_max` = 20 m/s^2 |
    | 1 | rate   | `-rate_max` = -10 rad/s | `rate_max` = 10 rad/s |

    ## Observation space
    `Box(-1, 1, (19,), float32)`. Lengths are asinh(l / 0.5 m) scaled to 1 at 20 m, speeds
    asinh(v / 1 m/s) scaled to 1 at 30 m/s: fine near zero, bounded far away.

    | # | name | meaning |
    |---|------|---------|
    | 0-1 | goal_x, goal_z | goal minus position |
    | 2-3 | velocity_x, velocity_z | velocity |
    | 4-5 | sin_theta, cos_theta | attitude |
    | 6-7 | hoop1_x, hoop1_z | centre of the next hoop minus position; zeros when there is none |
    | 8-9 | hoop1_direction_x, hoop1_direction_z | its direction of passage |
    | 10 | hoop1_diameter | its gap |
    | 11-15 | hoop2_... | the same of the hoop after it |
    | 16-17 | floor, ceiling | height above the floor, below the ceiling; 1 when there is none |
    | 18 | time | elapsed share of the time limit |

    ## Start
    At rest and upright at `scenario.start`; `reset(options={"state": [x, z, vx, vz, theta]})` starts
    anywhere, `options={"hoops_passed": n}` with n hoops already passed.

    ## Reward
    `reward="sparse"`: -dt a step; a failed flight pays the rest of the time limit at once, so the
    return is minus the flight time on success and minus the time limit otherwise.
    `reward="shaped"` (default) adds differences of a potential, which leave the optimal policy
    unchanged.

    ## Termination
    `goal` (within the tolerance, all hoops passed), `collision` (the body touches a rim; only with
    `Quadrotor(radius > 0)`), `floor`, `ceiling`, `out-of-bounds`. Crossings and contacts are found on
    the exact arc inside a step.

    ## Truncation
    `time-limit`, after `scenario.time_limit`.

    ## Info
    The same keys at every step: `state`, `time` [s], `steps`, `hoops_passed`, `is_success`, `outcome`
    (one of `flatgym.OUTCOMES`; "flying" until the end).

    ## Arguments
    `scenario`: a name of `flatgym.SCENARIOS` or a `Scenario`. `reward`: "shaped" or "sparse".

    ## Version history
    v0: first release.
    """

    metadata = {"render_modes": []}

    def __init__(
        self, scenario: ScenarioLike = DEFAULT_SCENARIO, reward: str = "shaped", render_mode: str | None = None
    ) -> None:
        self.scenario = catalogue.scenario(scenario)
        self.scene = Scene.of([self.scenario])
        self.shaped = check_reward(reward)
        self.render_mode = render_mode
        self.observation_space = observation_space()
        self.action_space = action_space()
        self._situation: Situation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a new flight; see the class for the options."""
        super().reset(seed=seed)
        self._situation = begin(self.scene, options)
        return task.observe(self.scene, self._situation)[0], self._info()

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly one step of dt; raises ResetNeeded before the first reset and after the end."""
        before = self._situation
        if before is None:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        if before.outcome[0] != FLYING:
            word = OUTCOMES[before.outcome[0]]
            raise gym.error.ResetNeeded(f"the flight has ended ({word!r}); call reset() before the next step()")
        control = self.scene.quadrotor.control(check_actions(action, (2,)))
        after = self._situation = task.advance(self.scene, before, control[None])
        reward = task.reward(self.scene, before, after, self.shaped)
        return (
            task.observe(self.scene, after)[0],
            float(reward[0]),
            bool(after.terminated[0]),
            bool(after.truncated[0]),
            self._info(),
        )

    def _info(self) -> dict[str, Any]:
        assert self._situation is not None
        arrays = task.info(self.scene, self._situation)
        return {key: values[0].copy() if key == "state" else values.tolist()[0] for key, values in arrays.items()}
