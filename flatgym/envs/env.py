"""FlatQuad-v0: the scalar Gymnasium environment, a fleet of one vehicle."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import ArrayLike, NDArray

from flatgym.envs.config import EnvConfig, Starts
from flatgym.envs.fleet import END, HOOPS_PASSED, OUTCOME, REWARD, STEPS, TIME, not_finite
from flatgym.envs.fleet_selection import make_fleet
from flatgym.envs.resetting import check_options, check_seed, known_k_star, start_episodes
from flatgym.envs.spaces import action_space, observation_space, take_actions
from flatgym.envs.specification import plain_spec
from flatgym.rendering.recorder import EpisodeRecorder
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.scenario import Scenario
from flatgym.task.scene import FLYING, GOAL, OUTCOMES, TIME_LIMIT

Observation = NDArray[np.float32]

ALL = np.ones(1, dtype=np.bool_)


class FlatQuadEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Fly a planar quadrotor from rest to rest, through hoops, in as few steps as possible.

    ## Dynamics
    State [x, z, vx, vz, theta] in m, m/s and rad; theta is the tilt from upright, positive towards +x. Control [f, w]:
    mass-normalised thrust f [m/s^2] and pitch rate w [rad/s]. Paper eqs. (3)-(5):

        x'' = f sin(theta),   z'' = f cos(theta) - g,   theta' = w,   g = 9.81 m/s^2

    The control is constant over a step of dt = 0.02 s. The step is exact: it evaluates the closed-form solution
    (`flatgym.quadrotor`), so there is no integration error. Limits, g, dt, tolerance and time limit are fields of
    `Scenario` and `Quadrotor`; this page states their defaults, which all named scenarios have.

    ## Action space
    `Box(-1, 1, (2,), float32)`, mapped affinely to the control. Finite actions outside the box are clipped. Actions
    that are not finite raise a ValueError.

    | # | action | -1 | +1 |
    |---|--------|----|----|
    | 0 | thrust | `thrust_min` = 1 m/s^2 | `thrust_max` = 20 m/s^2 |
    | 1 | rate   | `-rate_max` = -10 rad/s | `rate_max` = 10 rad/s |

    ## Observation space
    `observation="features"` (default): `Box(-1, 1, (19,), float32)`, named by `flatgym.observation_names()`. A length l
    appears as l / (2 m + |l|), a speed v as v / (4 m/s + |v|): high resolution near zero, bounded far away.
    `flatgym.task.observation.decode_observation` inverts this.

    | # | name | meaning |
    |---|------|---------|
    | 0-1 | goal_x, goal_z | goal minus position |
    | 2-3 | velocity_x, velocity_z | velocity |
    | 4-5 | sin_theta, cos_theta | attitude |
    | 6-7 | hoop1_x, hoop1_z | centre of the next hoop minus position; 0 without a next hoop |
    | 8-9 | hoop1_direction_x, hoop1_direction_z | its direction of passage, a unit vector; 0 without a next hoop |
    | 10 | hoop1_diameter | width of its gap; 0 without a next hoop |
    | 11-15 | hoop2_... | the same for the hoop after it |
    | 16-17 | floor, ceiling | height above the floor, distance to the ceiling; 1 without floor or ceiling |
    | 18 | time | elapsed fraction of the time limit |

    `observation="state"`: `Box(-inf, inf, (5,), float32)`, the state itself, named by
    `flatgym.observation_names("state")`. It does not contain goal and hoops.

    | # | name | unit |
    |---|------|------|
    | 0-1 | x, z | m |
    | 2-3 | vx, vz | m/s |
    | 4 | theta | rad, from upright, not wrapped |

    Gymnasium's `FrameStackObservation` stacks past observations.

    ## Reward
    `reward="sparse"`: -dt for each step. An episode that fails (terminates without reaching the goal) also pays the
    remaining time limit. The return is minus the flight time on success and minus the time limit otherwise.

    `reward="shaped"` (default): the sparse reward plus the change of a potential, which is minus an estimate of the
    time to go (`flatgym.task.shaping`) and 0 after termination. This leaves the optimal policy unchanged.

    ## Episode start
    At rest and upright at `scenario.start`, with no hoop passed. `reset(options={"state": [x, z, vx, vz, theta]})`
    starts in another state, `options={"hoops_passed": n}` with n hoops already passed. Sampled scenarios, disturbances
    and starts are functions of the seed given to `reset` and the number of resets since.

    ## Termination
    | outcome | condition |
    |---------|-----------|
    | goal | all hoops passed, within 0.1 m of the goal, speed <= 0.2 m/s, theta within 0.1 rad of a whole turn |
    | collision | the body touches a rim of a hoop; only with `Quadrotor(radius > 0)`, default 0 |
    | floor, ceiling | the path goes more than 1e-6 m below the floor or above the ceiling |
    | out-of-bounds | a step ends more than 5 m outside the bounding box of start, goal and hoop centres |

    A hoop counts as passed when the path crosses its gap in its direction; hoops count in order. Crossings and contacts
    are found on the exact path within a step, not at its ends only.

    ## Truncation
    `time-limit`, after `scenario.time_limit` = 5 s, 250 steps.

    ## Info
    The same keys after every reset and step.

    | key | value |
    |-----|-------|
    | state | [x, z, vx, vz, theta], shape (5,), float64, without sensor noise |
    | time | elapsed time [s] |
    | steps | environment steps of the episode |
    | hoops_passed | hoops passed so far |
    | is_success | whether the outcome is "goal" |
    | outcome | one of `flatgym.OUTCOMES`; "flying" until the episode ends |
    | k_star | K*, the fewest steps of the best-known solution of this episode; 0 if unknown |

    At the goal, `info["steps"] / info["k_star"] - 1` is the gap. K* is that of the undisturbed vehicle. It is unknown
    for scenarios other than the named ones, for episodes that start in another state, and for distributions except for
    the first episodes of the evaluation's seeds.

    ## Arguments
    | argument | default | meaning |
    |----------|---------|---------|
    | scenario | "hoop" | a name of `flatgym.SCENARIOS` or `flatgym.DISTRIBUTIONS`, a `Scenario` or a `Distribution` |
    | reward | "shaped" | or "sparse" |
    | observation | "features" | or "state" |
    | wind | 0 | maximum acceleration by a constant wind [m/s^2] |
    | thrust_gain | 0 | maximum relative error of the thrust |
    | mass | 0 | maximum relative error of the mass |
    | action_delay | 0 | maximum delay of the actions [steps] |
    | sensor_noise | 0 | standard deviation of the measured position [m], velocity [m/s] and tilt [rad] |
    | starts | None | `flatgym.envs.config.Starts`, a pool of start states for training |
    | ghost | False | True draws the best-known solution as well; or states (K+1, 5) of another trajectory |
    | render_mode | None | "human" or "rgb_array"; needs `flatgym[render]` |

    Wind, thrust error, mass error and delay are sampled once an episode (`flatgym.scenarios.disturbances`).

    ## Version history
    v0: first release.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}

    def __init__(
        self,
        scenario: ProblemLike = DEFAULT_SCENARIO,
        reward: str = "shaped",
        observation: str = "features",
        *,
        wind: float = 0.0,
        thrust_gain: float = 0.0,
        mass: float = 0.0,
        action_delay: int = 0,
        sensor_noise: float = 0.0,
        starts: Starts | None = None,
        ghost: bool | ArrayLike = False,
        render_mode: str | None = None,
    ) -> None:
        disturbances = Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise)
        config = EnvConfig(catalogue.problem(scenario), reward, observation, disturbances, starts)
        self.metadata = self.metadata | {"render_fps": 1 / config.dt}
        self._spec: EnvSpec | None = None
        self.recorder = EpisodeRecorder(config.problem, render_mode, ghost, scored=not disturbances.active)
        self.fleet = make_fleet(config, 1)
        self._action = self.fleet.actions[0]
        self.render_mode = render_mode
        self.observation_space = observation_space(observation)
        self.action_space = action_space()
        self._outcome: int | None = None
        self._k_star = 0

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: its action is a view of its own fleet's actions."""
        self.__dict__.update(state)
        self._action = self.fleet.actions[0]

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification, as plain data; None without `gym.make`."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        """Keep the specification as plain data."""
        self._spec = plain_spec(spec, self.fleet.config)

    @property
    def scenario(self) -> Scenario:
        """The scenario of the current episode."""
        problem = self.fleet.config.problem
        if isinstance(problem, Scenario):
            return problem
        return problem.scenario(int(self.fleet.seeds[0]), int(self.fleet.episodes[0]))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see the class for the options.

        Without a seed, the next episode of the present seed starts; before the first seed, a random one is chosen.
        """
        super().reset(seed=None if seed is None else check_seed(seed))
        if seed is None and self._outcome is None:
            seed = int(self.np_random.integers(2**63))
        seeds = None if seed is None else np.array([seed], dtype=np.uint64)
        options = check_options(options)
        observation, record = start_episodes(self.fleet, ALL, seeds, options)
        self._k_star = 0 if options else int(known_k_star(self.fleet, first=seeds is not None)[0])
        self._outcome, info = FLYING, self._info(record.numbers[:, 0].tolist())
        if self.render_mode is not None:
            self.recorder.start(info)
            self._show()
        return observation[0], info

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one step of dt.

        Args:
            action: shape (2,); see the class.

        Raises:
            gym.error.ResetNeeded: before the first reset and after the end of an episode.
            ValueError: for an action of another shape or one that is not finite; the vehicle has not moved then.
        """
        if self._outcome != FLYING:
            if self._outcome is None:
                raise gym.error.ResetNeeded("call reset() before the first step()")
            outcome = OUTCOMES[self._outcome]
            raise gym.error.ResetNeeded(f"the episode has ended ({outcome!r}); call reset() before the next step()")
        take_actions(action, self._action)
        try:
            result = self.fleet.step()
        except ValueError:
            raise not_finite(self._action) from None  # with indices into one action, not into a batch
        row = result.record.numbers[:, 0].tolist()
        info, end = self._info(row), int(row[END])
        self._outcome = end
        if self.render_mode is not None:
            self.recorder.add(float(self._action[0]), info)
            self._show()
        return result.observation[0], row[REWARD], end not in (FLYING, TIME_LIMIT), end == TIME_LIMIT, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the episode so far, shape (720, 960, 3); None in mode "human", which shows every step."""
        return self.recorder.draw(self.scenario) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one; the next episode opens it again."""
        self.recorder.close()

    def _show(self) -> None:
        if self.render_mode == "human":
            self.recorder.draw(self.scenario)

    def _info(self, row: list[float]) -> dict[str, Any]:
        outcome = int(row[OUTCOME])
        return {
            "state": np.array(row[0:5]),
            "time": row[TIME],
            "steps": int(row[STEPS]),
            "hoops_passed": int(row[HOOPS_PASSED]),
            "is_success": outcome == GOAL,
            "outcome": OUTCOMES[outcome],
            "k_star": self._k_star,
        }
