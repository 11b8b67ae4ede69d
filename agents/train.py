"""Train PPO on one scenario: a flat configuration in, the best policy and its learning curve out.

What makes it learn (plain resets learn nothing): starts flown backwards from the goal, a tolerance
that tightens to the true one, a discount that rises, and a learning rate that follows a wanted
Kullback-Leibler divergence between updates. Every few rollouts the deterministic policy flies the
true scenario; the policy that needed fewest steps is the one that is kept.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.utils import ConstantSchedule
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from agents.configs import TIGHT, PPOConfig
from agents.evaluate import fly
from agents.starts import backward_starts
from agents.vec_env import make_vec_env
from flatgym.catalogue import scenario
from flatgym.scenario import Tolerance
from flatgym.task import OBSERVATION_NAMES
from optimal.steps import FewestSteps


@dataclass(frozen=True)
class Training:
    """What a training gave.

    Attributes:
        config: what it was asked.
        model: file of the best policy.
        curve: one point a check: env_steps, wall_time_s, outcome, steps.
        env_steps: environment steps flown.
        wall_time_s: wall time [s].
    """

    config: PPOConfig
    model: Path
    curve: list[dict[str, Any]]
    env_steps: int
    wall_time_s: float


class Zoom(BaseFeaturesExtractor):
    """Multiplies all observations but sine and cosine of the attitude, which are of order one already."""

    def __init__(self, observation_space: Any, factor: float) -> None:
        super().__init__(observation_space, len(OBSERVATION_NAMES))
        scale = [1.0 if name.endswith("theta") else factor for name in OBSERVATION_NAMES]
        self.scale: torch.Tensor
        self.register_buffer("scale", torch.tensor(scale))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the scaled observations, shape (n, 19)."""
        return observations * self.scale


class GentleFailure(VecEnvWrapper):
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


class Schedules(BaseCallback):
    """Runs all schedules, flies the deterministic policy, keeps the best, and stops in time."""

    model: PPO

    def __init__(self, config: PPOConfig, target: float) -> None:
        super().__init__()
        self.config, self.target, self.scenario = config, target, scenario(config.scenario)
        self.began, self.rollouts, self.rate = math.inf, 0, config.learning_rate
        self.curve: list[dict[str, Any]] = []
        self.best = np.inf
        self.best_parameters: dict[str, torch.Tensor] | None = None

    @property
    def elapsed(self) -> float:
        """Wall time since training began [s]."""
        return time.perf_counter() - self.began

    def _on_training_start(self) -> None:
        self.began = time.perf_counter()

    def _on_step(self) -> bool:
        return self.best > self.target and self.elapsed < self.config.seconds

    def _on_rollout_end(self) -> None:
        done = min(1.0, max(self.num_timesteps / self.config.env_steps, self.elapsed / self.config.seconds))
        self._tighten(done)
        self._come_home(done)
        self._discount(done)
        self._steer(done)
        self.rollouts += 1
        if self.rollouts % self.config.check_every == 0:
            self.check()

    def _on_training_end(self) -> None:
        self.check()
        if self.best_parameters is not None:
            self.model.policy.load_state_dict(self.best_parameters)

    def _tighten(self, done: float) -> None:
        factor, true = 1 + (self.config.tolerance - 1) * max(0.0, 1 - done / TIGHT), self.scenario.tolerance
        eased = Tolerance(true.position * factor, true.speed * factor, true.angle * factor)
        self.training_env.env_method("set_tolerance", eased)

    def _come_home(self, done: float) -> None:
        first, last = self.config.drawn, self.config.drawn_end
        share = first + (last - first) * max(0.0, (done - TIGHT) / (1 - TIGHT))
        self.training_env.env_method("set_share", share)

    def _discount(self, done: float) -> None:
        first, last = self.config.discount, self.config.discount_end
        self.model.gamma = self.model.rollout_buffer.gamma = first + (last - first) * min(1.0, done / 0.6)

    def _steer(self, done: float) -> None:
        wanted = self.config.divergence * max(self.config.divergence_end, 1 - done)
        was = self.logger.name_to_value.get("train/approx_kl", 0.0)
        if was > 2 * wanted:
            self.rate /= 1.5
        elif 0 < was < wanted / 2:
            self.rate = min(1.5 * self.rate, self.config.learning_rate_max)
        self.model.lr_schedule = ConstantSchedule(self.rate)

    def check(self) -> None:
        """Fly the true scenario deterministically, extend the curve, and remember the policy if it is the best."""
        flights = fly(self.model, self.scenario)
        steps, outcome = int(flights.steps[0]), flights.outcomes[0]
        point = {"env_steps": self.num_timesteps, "wall_time_s": round(self.elapsed, 1)}
        self.curve.append(point | {"outcome": outcome, "steps": steps})
        with curve_file(self.config).open("a", encoding="utf-8") as file:
            file.write(json.dumps(self.curve[-1]) + "\n")
        if outcome == "goal" and steps < self.best:
            self.best = steps
            self.best_parameters = {name: value.clone() for name, value in self.model.policy.state_dict().items()}


def curve_file(config: PPOConfig) -> Path:
    """Return the file to which a training appends its learning curve, one JSON object a line."""
    return Path(config.folder) / "curve.jsonl"


def read_curve(config: PPOConfig) -> list[dict[str, Any]]:
    """Return the learning curve so far, also of a training that is still running."""
    try:
        lines = curve_file(config).read_text(encoding="utf-8").splitlines(keepends=True)
    except FileNotFoundError:
        return []
    return [json.loads(line) for line in lines if line.endswith("\n")]


def build(config: PPOConfig) -> PPO:
    """Return an untrained PPO whose flights begin at states flown backwards from the goal."""
    starts = backward_starts(
        scenario(config.scenario),
        share=config.drawn,
        near=config.near,
        back_time=config.back_time,
        seed=config.seed,
    )
    envs = make_vec_env(config.scenario, config.num_envs, starts=starts, seed=config.seed)
    return PPO(
        "MlpPolicy",
        GentleFailure(envs, config.failure),
        n_steps=config.rollout,
        batch_size=config.batch,
        n_epochs=config.epochs,
        learning_rate=config.learning_rate,
        gamma=config.discount,
        gae_lambda=config.gae,
        seed=config.seed,
        device="cpu",
        policy_kwargs={
            "net_arch": [config.width] * 2,
            "activation_fn": torch.nn.ELU,
            "log_std_init": config.log_std,
            "features_extractor_class": Zoom,
            "features_extractor_kwargs": {"factor": config.zoom},
        },
    )


def train(config: PPOConfig, optimum: FewestSteps | None = None) -> Training:
    """Train PPO and keep the best deterministic policy met on the way.

    Args:
        config: everything the training depends on; the same configuration gives the same policy, unless
            the clock comes before `env_steps`.
        optimum: K*, if known: training stops when the policy flies in K* steps.

    Returns:
        The model's file and the learning curve; `config.folder` holds both and the configuration.
    """
    folder = Path(config.folder)
    folder.mkdir(parents=True, exist_ok=True)
    curve_file(config).write_text("", encoding="utf-8")
    (folder / "config.json").write_text(json.dumps(asdict(config), indent=1) + "\n", encoding="utf-8")
    torch.set_num_threads(1)  # small networks: a second thread costs more than it gives
    schedules = Schedules(config, target=-np.inf if optimum is None else optimum.steps)
    model = build(config).learn(config.env_steps, callback=schedules)
    temporary, file = folder / "model.part.zip", folder / "model.zip"
    model.save(temporary)
    temporary.replace(file)
    return Training(config, file, schedules.curve, model.num_timesteps, schedules.elapsed)


def load(model: Path) -> PPO:
    """Return a trained policy. Loading a Stable-Baselines3 file executes code in it: load only your own."""
    return PPO.load(model, device="cpu")
