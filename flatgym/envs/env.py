"""FlatQuad-v0, one vehicle at a time: a thin Gymnasium shell around a fleet of one."""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.envs.config import EnvConfig, Starts
from flatgym.envs.fleet import END, HOOPS_PASSED, OUTCOME, REWARD, STEPS, TIME, Fleet, not_finite
from flatgym.envs.resetting import begin, check_options, check_seed, known_k_star
from flatgym.envs.spaces import action_space, observation_space, take_actions
from flatgym.rendering.recorder import EpisodeRecorder
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.scenario import Scenario
from flatgym.task.scene import FLYING, GOAL, OUTCOMES, TIME_LIMIT

Observation = NDArray[np.float32]

ALL = np.ones(1, dtype=np.bool_)


def fleet_of(course: EnvConfig, n: int, same_step: bool = False) -> Fleet:
    """Return a fleet: compiled where numba is installed."""
    if find_spec("numba") is None:
        return Fleet(course, n, same_step)
    from flatgym.envs.compiled_fleet import CompiledFleet

    return CompiledFleet(course, n, same_step)


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
    `observation="features"` (default): `Box(-1, 1, (19,), float32)`, named by `flatgym.observation_names()`. Lengths
    are seen as l / (2 m + |l|), speeds as v / (4 m/s + |v|): fine near zero, bounded far away.

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

    `observation="state"`: `Box(-inf, inf, (5,), float32)`, the state itself, named by
    `flatgym.observation_names("state")`; it does not tell goal and hoops.

    | # | name | unit |
    |---|------|------|
    | 0-1 | x, z | m |
    | 2-3 | vx, vz | m/s |
    | 4 | theta | rad, from the upright, not wrapped |

    Several past observations at once are what Gymnasium's FrameStackObservation is for.

    ## Start
    At rest and upright at `scenario.start`. What is drawn at random - a scenario of a distribution, disturbances - is a
    function of the seed given to `reset` and the number of resets since, and of nothing else.
    `reset(options={"state": [x, z, vx, vz, theta]})` starts anywhere, `options={"hoops_passed": n}` with n hoops
    already passed.

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
    (one of `flatgym.OUTCOMES`; "flying" until the end), and `k_star`: the fewest steps in which a flight of the present
    episode is known, NaN where none is, as in an episode that begins elsewhere than at the start. So at the goal
    `info["steps"] / info["k_star"] - 1` is the gap. It is that of the undisturbed vehicle.

    ## Arguments
    | argument | default | meaning |
    |----------|---------|---------|
    | scenario | "hoop" | a name of `flatgym.SCENARIOS` or `flatgym.DISTRIBUTIONS`, a `Scenario` or a `Distribution` |
    | reward | "shaped" | or "sparse" |
    | observation | "features" | or "state" |
    | wind | 0 | greatest acceleration by a constant wind [m/s^2] |
    | thrust_gain | 0 | greatest relative error of the thrust |
    | mass | 0 | greatest relative error of the mass |
    | action_delay | 0 | most steps by which actions come late |
    | sensor_noise | 0 | standard deviation of what is measured [m, m/s, rad]; `info` tells the truth |
    | starts | None | a `flatgym.envs.config.Starts`, a pool of states in which episodes begin, for training |
    | ghost | False | True to draw the best flight known beside, or states (K+1, 5) of another |
    | render_mode | None | "human" or "rgb_array"; needs the extra `render` |

    Disturbances are drawn anew each episode, see `flatgym.scenarios.disturbances`; all are off by default.

    ## Version history
    v0: first release.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 50}

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
        course = EnvConfig(catalogue.problem(scenario), reward, observation, disturbances, starts)
        self.film = EpisodeRecorder(course.problem, render_mode, ghost, scored=not disturbances.active)
        self.fleet = fleet_of(course, 1)
        self._action = self.fleet.actions[0]
        self.render_mode = render_mode
        self.observation_space = observation_space(observation)
        self.action_space = action_space()
        self._outcome: int | None = None
        self._k_star = math.nan

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: its action is part of its own fleet's."""
        self.__dict__.update(state)
        self._action = self.fleet.actions[0]

    @property
    def scenario(self) -> Scenario:
        """The scenario of the present episode."""
        problem = self.fleet.course.problem
        if isinstance(problem, Scenario):
            return problem
        return problem.scenario(int(self.fleet.seeds[0]), int(self.fleet.episodes[0]))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a new flight; see the class for the options."""
        super().reset(seed=None if seed is None else check_seed(seed))
        if seed is None and self._outcome is None:
            seed = int(self.np_random.integers(2**63))
        seeds = None if seed is None else np.array([seed], dtype=np.uint64)
        options = check_options(options)
        observation, record = begin(self.fleet, ALL, seeds, options)
        self._k_star = math.nan if options else float(known_k_star(self.fleet, first=seeds is not None)[0])
        self._outcome, info = FLYING, self._info(record.numbers[:, 0].tolist())
        if self.render_mode is not None:  # to build a drawn scenario takes longer than to begin flying it
            self.film.begin(self.scenario, info)
        return observation[0], info

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly one step of dt; raises ResetNeeded before the first reset and after the end."""
        if self._outcome != FLYING:
            if self._outcome is None:
                raise gym.error.ResetNeeded("call reset() before the first step()")
            word = OUTCOMES[self._outcome]
            raise gym.error.ResetNeeded(f"the flight has ended ({word!r}); call reset() before the next step()")
        take_actions(action, self._action)
        if not all(map(math.isfinite, self._action.tolist())):
            raise not_finite(self._action)
        flown = self.fleet.step()
        row = flown.record.numbers[:, 0].tolist()
        info, end = self._info(row), int(row[END])
        self._outcome = end
        self.film.add(action, info)
        return flown.observation[0], row[REWARD], end not in (FLYING, TIME_LIMIT), end == TIME_LIMIT, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the flight so far, shape (720, 960, 3); None in a window, which shows every step."""
        return self.film.draw()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.film.close()

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
