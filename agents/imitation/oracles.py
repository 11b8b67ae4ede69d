"""Expert oracles: the actions an expert takes at the states a policy visits.

`lqr_oracle` labels every step by the time-varying LQR around an optimal flight. `combined_oracle` is for distributions:

- the LQR around the optimal flight of each scenario, which leads through the hoops at little cost;
- after the last hoop, a new plan to the goal from the visited state, which takes milliseconds;
- after a missed hoop, or far from the flight, a cascaded PD controller, which is slow but robust. It labels no other
  states, because the policy would become as slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import joblib
import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.lqr import tolerances
from agents.controllers.tracking import TrackingControllers
from agents.evaluation.rollouts import fly
from agents.imitation.dataset import ExpertData, concatenate, with_mirror_images
from agents.imitation.dataset_aggregation import ExpertOracle
from agents.imitation.trajectories import plan_labels, time_reversed
from agents.policies.policy import Policy
from flatgym import task
from flatgym.quadrotor import Array
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.scenario import Tolerance
from flatgym.task.scene import FLYING, EpisodeState, Integers, Scene
from optimal.discrete.fewest_steps import FewestSteps
from optimal.parallel import parallel_results

START_STD = tolerances(Tolerance())
"""Standard deviations of the start states for a `start_noise` of 1: the goal tolerance [m, m, m/s, m/s, rad]."""
LOST_DISTANCE = 30.0
"""Distance from the expert's flight, in tolerances, at which an episode counts as lost."""
HOOP_LAG = 2
"""Points of the expert's flight by which an episode may lag at a hoop before the hoop counts as missed."""
HOVER_STRIDE = 3
"""One of so many steps is labelled while hovering at the goal, which may take long."""
LAG_WINDOW = range(-6, 4)
"""Points around the current one that `combined_oracle` searches for the nearest point of the flight."""


def lqr_oracle(
    flights: Sequence[FewestSteps],
    *,
    count: int = 32,
    start_noise: float = 0.05,
    action_noise: float = 0.05,
    window: Sequence[int] = (0,),
    fallback: Policy | None = None,
    after_last_hoop: bool = True,
    seed: int = 0,
) -> ExpertOracle:
    """Return the oracle of the LQRs around optimal flights.

    Args:
        flights: optimal flights of scenarios that share vehicle, step and tolerance.
        count: episodes of a round; the expert's own round flies all flights. Episode 0 starts exactly at the start of
            the first flight and has no action noise. The others follow flights sampled without replacement.
        start_noise: standard deviation of their start states, in units of START_STD.
        action_noise: standard deviation of the noise on the actions of every other episode.
        window: as in `TrackingControllers`.
        fallback: labels lost episodes: those that missed a hoop, until the last hoop is passed, and those too far from
            the flight. Without a fallback a lost episode ends.
        after_last_hoop: whether states after the last hoop are labelled. There the LQR leads back to its flight, not
            to the goal in the fewest steps. Lost episodes are labelled in any case.
        seed: seed of flights, starts and noise.
    """
    controllers = TrackingControllers(flights, window)
    due = controllers.hoops_passed()

    def label(policy: PPO | None, number: int) -> ExpertData:
        generator = np.random.default_rng((seed, number))
        size = max(count, len(flights)) if policy is None else count
        which = _sample_flights(len(flights), size, generator)
        scene = Scene.of([flights[i].scenario for i in which])
        episodes = _start(scene, controllers.states[which, 0], start_noise, generator)
        std = action_noise * (np.arange(size) % 2)[:, None]
        point, missed, flying = np.full(size, -1), np.zeros(size, dtype=bool), np.ones(size, dtype=bool)
        rows, env_steps, skip_through = [], 0, not after_last_hoop and policy is not None
        while True:
            point, off, distance = controllers.nearest(which, episodes.state, point)
            missed |= episodes.hoops_passed < due[which, np.maximum(point - HOOP_LAG, 0)]
            lost = _lost(scene, episodes, missed, distance)
            flying &= (episodes.outcome == FLYING) & ~(lost & (fallback is None))
            if not flying.any():
                break
            observations, labels = task.observe(scene, episodes), controllers.action(which, point, off)
            if fallback is not None:
                labels = np.where(lost[:, None], fallback.predict(observations)[0], labels)
            counts = flying & (lost | ~_redundant(scene, episodes, point == controllers.last[which], skip_through))
            rows.append(ExpertData(observations[counts], labels[counts], labels=int(counts.sum())))
            env_steps += int(flying.sum())
            actions = labels if policy is None else policy.predict(observations, deterministic=True)[0]
            actions = np.clip(actions + std * generator.normal(size=actions.shape), -1, 1)
            episodes = task.advance(scene, episodes, scene.quadrotor.control(actions))
        return concatenate(rows)._replace(env_steps=0 if policy is None else env_steps)

    return label


def _sample_flights(flights: int, size: int, generator: np.random.Generator) -> Integers:
    """Return the flight of each episode, shape (size,): the first flight, then others without replacement."""
    others = generator.permutation(np.arange(1, max(size, flights)))
    return np.append(0, others[: size - 1] % flights)


def _start(scene: Scene, states: Array, noise: float, generator: np.random.Generator) -> EpisodeState:
    """Return episodes at states (n, 5), perturbed but for the first, and between floor and ceiling."""
    states, zero = states.copy(), np.zeros(len(states), dtype=np.int64)
    states[1:] += noise * START_STD * generator.normal(size=(len(states) - 1, 5))
    states[:, 1] = np.clip(states[:, 1], scene.floor, scene.ceiling)
    return EpisodeState(states, zero, zero, zero)


def _lost(scene: Scene, episodes: EpisodeState, missed: NDArray[np.bool_], distance: Array) -> NDArray[np.bool_]:
    """Return which episodes are lost, shape (n,): before the last hoop after a miss, or too far from the flight."""
    return (missed & (episodes.hoops_passed < scene.hoop_count)) | (distance >= LOST_DISTANCE)


def _redundant(
    scene: Scene, episodes: EpisodeState, hovers: NDArray[np.bool_], skip_through: bool
) -> NDArray[np.bool_]:
    """Return which states need no label, shape (n,): most of hovering, and those after the last hoop if asked."""
    through = episodes.hoops_passed == scene.hoop_count
    return (hovers & (episodes.steps % HOVER_STRIDE > 0)) | (through & skip_through)


def combined_oracle(
    flights: Sequence[FewestSteps],
    distribution: Distribution,
    *,
    count: int = 1600,
    plan_episodes: int = 200,
    plan_every: int = 5,
    plan_steps: int = 30,
    plan_weight: int = 3,
    seed: int = 0,
    jobs: int = -1,
) -> ExpertOracle:
    """Return the oracle for a distribution: LQR, replanning after the last hoop, and cascaded PD for lost episodes.

    The LQRs also follow each flight reversed in time. All labels are returned with their mirror images.

    Args:
        flights: optimal flights of `distribution.scenario(i)`, i = 0, 1, ..., or of the same with narrower hoops.
        distribution: the distribution of the scenarios.
        count: episodes of a round that the LQRs label.
        plan_episodes: episodes of a round with replanning after the last hoop.
        plan_every: steps between plans.
        plan_steps: steps of each plan that become labels.
        plan_weight: number of copies of each plan's labels in the data.
        seed: seed of starts and noise.
        jobs: worker processes.
    """
    own = [replace(flight, scenario=distribution.scenario(i)) for i, flight in enumerate(flights)]
    lqr = lqr_oracle(
        [*own, *map(time_reversed, own)],
        count=count,
        start_noise=0.3,
        window=LAG_WINDOW,
        fallback=CascadedPD(distribution.quadrotor),
        after_last_hoop=False,
        seed=seed,
    )

    def label(policy: PPO | None, number: int) -> ExpertData:
        if policy is None:
            return with_mirror_images(lqr(None, number))
        first = (number * plan_episodes) % max(1, len(own) - plan_episodes)
        episodes = fly(policy, distribution, min(plan_episodes, len(own)), first)
        calls = (
            joblib.delayed(plan_labels)(flight, states, actions, plan_every, plan_steps)
            for flight, states, actions in zip(own[first:], episodes.states, episodes.actions, strict=False)
        )
        plans = concatenate(list(parallel_results(calls, jobs)))._replace(env_steps=int(episodes.steps.sum()))
        copies = [plans._replace(env_steps=0, labels=0)] * (plan_weight - 1)
        return with_mirror_images(concatenate([lqr(policy, number), plans, *copies]))

    return label
