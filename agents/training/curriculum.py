"""Curriculum: early in training the tolerance is larger, episodes start near the goal, and failure costs less.

Every quantity is a function of `done`, the completed share of the training in [0, 1]. A training can therefore resume
at any point.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from agents.training.backward_starts import backward_starts
from agents.training.configs import TOLERANCE_SHARE, Config
from flatgym.envs.config import Starts
from flatgym.envs.fleet import Fleet
from flatgym.quadrotor import Array
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import reference
from flatgym.scenarios.scenario import Scenario, Tolerance
from flatgym.task.rollout import fly_actions
from optimal.discrete.fewest_steps import fewest_steps

NEAREST_SHARE = 0.2
"""Share of the expert's flight, counted back from the goal, from which episodes start at first."""


class TrainingReward(VecEnvWrapper):
    """The training reward: a failed episode costs `price` for each hoop still ahead, but at least once.

    With P the potential (`flatgym.task.shaping`) and s the state before the step that fails, k steps after s_0, a
    failure returns, without discount,

        -k dt + P(s) - P(s_0) - price max(1, hoops ahead),

    so among failures those return more that passed more hoops, or end nearer to the goal. The environment's own reward
    charges the remaining time limit, by which all failures from a start are alike, and which deters an untrained policy
    from the goal.

    The optimum stays where it is as long as the cost exceeds what the potential underestimates. Let V(s) be the least
    time to the goal. By optimality K* dt <= k dt + V(s), so a failure returns less than the optimal flight,
    -K* dt - P(s_0), if V(s) + P(s) < price max(1, hoops ahead). The potential assumes 5 m/s through hoops; a fixed cost
    of 0.5 s made it better to fail at once than to fly the optimum of `slalom`, `ladder`, `slalom-6` and `zigzag-12`.

    With `turns`, only a flight with that number of whole turns of the tilt succeeds: the goal with any other number is
    a failure, also in `is_success`. It selects a homotopy class, as the optimal solvers do. Neighbouring classes are
    local optima, which gradual improvement does not leave. The potential then also counts the time to turn at the
    greatest rate.

    Args:
        venv: the environments; their starts count the tilt from 0 at the scenario's start.
        price: cost of a failure [s].
        turns: whole turns of the tilt at the goal, positive ones to the right; None for any number.
    """

    def __init__(self, venv: Any, price: float, turns: int | None = None) -> None:
        super().__init__(venv)
        self.price, self.turns = price, turns
        self.rate = venv.get_attr("scenario")[0].quadrotor.rate_max

    def reset(self) -> Any:
        """Reset all episodes."""
        observations = self.venv.reset()
        self._hoops, self._turning = self._fleet.hoop_counts(), self._time_to_turn(self._tilts())
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Step once; an episode fails if it ends neither at the goal, with the turns, nor at the time limit."""
        observations, rewards, dones, infos = self.venv.step_wait()
        before, self._turning = self._turning, self._time_to_turn(self._tilts())
        after, ended = self._turning.copy(), np.flatnonzero(dones)
        for i in ended:
            infos[i]["is_success"] = self._succeeds(infos[i])
            if infos[i]["outcome"] == "time-limit":
                after[i] = self._time_to_turn(infos[i]["state"][4])
            elif infos[i]["is_success"]:
                after[i] = 0.0
            else:
                rewards[i] = -self.price * max(1, self._hoops[i] - infos[i]["hoops_passed"])
                after[i] = before[i]
        if ended.size:
            self._hoops = self._fleet.hoop_counts()  # of the episodes that follow
        return observations, rewards + (before - after).astype(np.float32), dones, infos

    def _tilts(self) -> Array:
        """Return the tilts of all vehicles [rad], shape (n,)."""
        tilts: Array = self.venv.unwrapped.arrays["state"][:, 4]  # type: ignore[attr-defined]
        return tilts

    def _time_to_turn(self, tilt: Any) -> Any:
        """Return the least time from tilts to that of the goal, with the turns [s]; 0 for any number of turns."""
        return 0.0 * tilt if self.turns is None else np.abs(2 * np.pi * self.turns - tilt) / self.rate

    def _succeeds(self, info: dict[str, Any]) -> bool:
        """Return whether an episode that has ended reached the goal, with the turns."""
        turns = round(float(info["state"][4]) / (2 * np.pi))
        return info["outcome"] == "goal" and self.turns in (None, turns)

    @property
    def _fleet(self) -> Fleet:
        fleet: Fleet = self.venv.get_attr("fleet")[0]
        return fleet


class Curriculum:
    """Tolerance and start states of the training environments as functions of `done`."""

    def __init__(self, config: Config) -> None:
        self.config, self.problem = config, catalogue.problem(config.scenario)
        self.pool: Starts | None = None
        self.flight: Starts | None = None
        if not isinstance(self.problem, Scenario):
            return
        self.pool = backward_starts(
            self.problem,
            share=config.pool_share,
            near=config.pool_near_share,
            back_time=config.max_back_time,
            turns=config.turns or 0,
            seed=config.seed,
        )
        if config.pool_expert_share:
            self.flight = expert_flight(self.problem)

    def tolerance(self, done: float) -> Tolerance:
        """Return the goal tolerance: the true one times a factor that falls to 1 by TOLERANCE_SHARE."""
        factor, true = 1 + (self.config.tolerance - 1) * max(0.0, 1 - done / TOLERANCE_SHARE), self.problem.tolerance
        return Tolerance(true.position * factor, true.speed * factor, true.angle * factor)

    def share(self, done: float) -> float:
        """Return the share of episodes that start from the pool."""
        first, last = self.config.pool_share, self.config.pool_share_end
        return first + (last - first) * max(0.0, (done - TOLERANCE_SHARE) / (1 - TOLERANCE_SHARE))

    def starts(self, done: float) -> Starts | None:
        """Return the pool of start states; a share of it lies on the expert's flight, ever farther from the goal."""
        if self.pool is None or self.flight is None:
            return self.pool
        generator = np.random.default_rng(self.config.seed)
        rows = np.flatnonzero(generator.random(len(self.pool.state)) < self.config.pool_expert_share)
        back = NEAREST_SHARE + (1 - NEAREST_SHARE) * min(1.0, done / TOLERANCE_SHARE)
        last = len(self.flight.state) - 1
        which = last - np.floor(generator.random(len(rows)) * back * (last + 1)).astype(np.int64)
        state, passed = self.pool.state.copy(), self.pool.hoops_passed.copy()
        state[rows], passed[rows] = self.flight.state[which], self.flight.hoops_passed[which]
        return Starts(state, passed, self.share(done))

    def apply(self, envs: VecEnv, done: float) -> None:
        """Set tolerance and start states of the environments, from the next step and the next episode on."""
        envs.env_method("set_tolerance", self.tolerance(done))
        if (starts := self.starts(done)) is None:
            return
        envs.env_method("set_share", self.share(done))
        if self.flight is not None:
            envs.env_method("set_starts", starts)


@lru_cache(maxsize=1)
def curriculum(config: Config) -> Curriculum:
    """Return the curriculum of a training; the last one is cached, because sampling the pool takes a moment."""
    return Curriculum(config)


def expert_flight(problem: Scenario) -> Starts:
    """Return the states of an optimal (K*) episode before its last step, with the hoops passed."""
    known = reference(problem)
    actions = fewest_steps(problem).actions if known is None else known.actions
    situations = fly_actions(problem, actions)[:-1]
    state = np.concatenate([situation.state for situation in situations])
    return Starts(state, np.concatenate([situation.hoops_passed for situation in situations]))
