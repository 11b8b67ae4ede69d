"""What is made easier at first: the goal is wider, the flights begin nearer to it, to fail costs little.

`done` is the share of the training that is over, in [0, 1]; all is a function of it, so that a training
can be taken up anywhere.
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
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import reference
from flatgym.scenarios.scenario import Scenario, Tolerance
from flatgym.task.rollout import fly_actions
from optimal.discrete.fewest_steps import fewest_steps

NEAREST_SHARE = 0.2
"""Share of a demonstrated flight, back from the goal, on which training begins at first."""


class FixedFailureCost(VecEnvWrapper):
    """Charges a fixed price for a failed flight instead of the environment's own."""

    def __init__(self, venv: Any, price: float) -> None:
        super().__init__(venv)
        self.price = price

    def reset(self) -> Any:
        """Start all flights anew."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Fly one step; a failed flight is one that ended neither at the goal nor with the clock."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for i in np.flatnonzero(dones):
            if infos[i]["outcome"] not in ("goal", "time-limit"):
                rewards[i] = -self.price
        return observations, rewards, dones, infos


class Curriculum:
    """What the environments of a training are to be at each time of it."""

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
            seed=config.seed,
        )
        if config.pool_expert_share:
            self.flight = expert_flight(self.problem)

    def tolerance(self, done: float) -> Tolerance:
        """Return what counts as arrived: the true tolerance, widened by a factor that falls to 1 by TIGHT."""
        factor, true = 1 + (self.config.tolerance - 1) * max(0.0, 1 - done / TOLERANCE_SHARE), self.problem.tolerance
        return Tolerance(true.position * factor, true.speed * factor, true.angle * factor)

    def share(self, done: float) -> float:
        """Return the share of flights that begin in the pool of starts."""
        first, last = self.config.pool_share, self.config.pool_share_end
        return first + (last - first) * max(0.0, (done - TOLERANCE_SHARE) / (1 - TOLERANCE_SHARE))

    def starts(self, done: float) -> Starts | None:
        """Return the pool of starts: a share of it on the demonstrated flight, ever farther from the goal."""
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
        """Make the environments what they are to be at this time, from the next step and the next flight on."""
        envs.env_method("set_tolerance", self.tolerance(done))
        if (starts := self.starts(done)) is None:
            return
        envs.env_method("set_share", self.share(done))
        if self.flight is not None:
            envs.env_method("set_starts", starts)


@lru_cache(maxsize=1)
def curriculum(config: Config) -> Curriculum:
    """Return the curriculum of a training; drawing the starts takes a moment, so the last one is kept."""
    return Curriculum(config)


def expert_flight(problem: Scenario) -> Starts:
    """Return the states of a flight in K* steps before its last, with the hoops passed by then."""
    known = reference(problem)
    actions = fewest_steps(problem).actions if known is None else known.actions
    situations = fly_actions(problem, actions)[:-1]
    state = np.concatenate([situation.state for situation in situations])
    return Starts(state, np.concatenate([situation.hoops_passed for situation in situations]))
