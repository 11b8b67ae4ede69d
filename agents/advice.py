"""Advice: what an expert would have done where a learner came to - the half of DAgger that knows the optimum.

On one scenario the expert is the regulator about its optimal flight, and advises at every step. On a distribution
every flight has another optimum: there the expert plans anew from states that the learner came to, and what it would
have flown from them is shown. Who has missed a hoop is too far from any plan; how to come back is shown by the
cascaded controller, which is slow but gets there. It is shown nowhere else, or learners would become as slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents.cascade import Cascade
from agents.evaluate import fly
from agents.experts import Expert, tolerances
from agents.imitation import Adviser, Shown, joined, mirrored
from agents.replanner import continuations
from flatgym import task
from flatgym.distributions import Distribution
from flatgym.quadrotor import Array
from flatgym.scenario import Scenario, Tolerance
from flatgym.scene import OUTCOMES, Integers, Scene, Situation
from flatgym.vector import FlatQuadVectorEnv
from optimal.steps import FewestSteps, judged

SCATTER = tolerances(Tolerance())
"""Standard deviations by which starts are scattered, times `scatter` [m, m, m/s, m/s, rad]: the tolerance's."""
THIRD = 3
"""Of the states from which a learner is to come back, one in so many is shown."""
ASTRAY = 30.0
"""How far from the expert's flight, in tolerances, a learner's flight is given up."""


def regulated(
    expert: Expert, scenario: Scenario, *, flights: int = 32, scatter: float = 0.05, noise: float = 0.05, seed: int = 0
) -> Adviser:
    """Return the advice of the regulator about an optimal flight.

    Args:
        expert: the regulator.
        scenario: what is flown.
        flights: of each round, the first of them from the very start and without noise.
        scatter: how far the others' starts are scattered, as a factor on SCATTER.
        noise: standard deviation of the noise on the actions of half of them.
        seed: of scatter and noise.
    """

    def advise(learner: PPO | None, number: int) -> Shown:
        generator = np.random.default_rng((seed, number))
        envs = FlatQuadVectorEnv(flights, scenario=scenario, reward="sparse")
        start = scenario.start_state + scatter * SCATTER * generator.normal(size=(flights, 5))
        start[0] = scenario.start_state
        if scenario.floor is not None:
            start[:, 1] = np.maximum(start[:, 1], scenario.floor)
        observations, infos = envs.reset(seed=0, options={"state": start})
        spread, flying = noise * (np.arange(flights) % 2)[:, None], np.ones(flights, dtype=bool)
        seen, told = [], []
        while flying.any():
            advice = expert.action(infos["state"], infos["steps"])
            seen.append(observations[flying])
            told.append(advice[flying])
            actions = advice if learner is None else learner.predict(observations, deterministic=True)[0]
            actions = np.clip(actions + spread * generator.normal(size=(flights, 2)), -1, 1)
            observations, _, _, _, infos = envs.step(actions)
            flying &= infos["outcome"] == OUTCOMES[0]
            flying &= expert.distance(infos["state"], infos["steps"]) < ASTRAY
        steps = sum(map(len, told))
        return Shown(np.concatenate(seen), np.concatenate(told), 0 if learner is None else steps, steps)

    return advise


def replanned(
    flights: Sequence[FewestSteps],
    distribution: Distribution,
    *,
    count: int = 200,
    every: int = 12,
    ahead: int = 30,
    extra: int = 20,
    jobs: int = -1,
) -> Adviser:
    """Return the advice of the expert that plans anew, on flights through drawn scenarios; in a mirror too.

    What is shown at first, the optimal flights themselves, is shown backwards in time as well.

    Args:
        flights: optimal flights of `distribution.scenario(i)`, i = 0, 1, ..., or of the same with narrower hoops,
            through which it is then planned where it can be.
        distribution: from which they are drawn.
        count: flights of a round.
        every: steps between plans.
        ahead: steps of a plan that are shown.
        extra: steps beyond K* that a learner's flight is followed.
        jobs: worker processes.
    """
    scenarios = [distribution.scenario(i) for i in range(len(flights))]

    def one(number: int, states: Array, actions: NDArray[np.float32]) -> list[Shown]:
        flight, scenario = flights[number], scenarios[number]
        passed, last = hoops_along(scenario, states, actions), min(len(flight.actions) + extra, len(states) - 1)
        plans = list(continuations(flight, states[:last], passed[:last], every, scenario))
        shown = [
            seen_along(scenario, plan.states[: ahead + 1], plan.actions[:ahead], plan.step, plan.hoops_passed)
            for plan in plans
        ]
        lost = min(last, (plans[-1].step if plans else 0) + every)
        missed = lost + np.flatnonzero(passed[lost:-1] < len(scenario.hoops))
        return [*shown, brought_back(scenario, states[missed], passed[missed], missed)]

    def advise(learner: PPO | None, number: int) -> Shown:
        if learner is None:
            own = [
                (scenario, flight.states, flight.actions) for scenario, flight in zip(scenarios, flights, strict=True)
            ]
            seen = [seen_along(*one) for one in own]
            back = [seen_along(*backwards(*one))._replace(asked=0) for one in own]
            return mirrored(joined([*seen, *back]))
        first = (number * count) % max(1, len(flights) - count)
        found = fly(learner, distribution, min(count, len(flights)), first)
        calls = [
            joblib.delayed(one)(first + i, states, actions)
            for i, (states, actions) in enumerate(zip(found.states, found.actions, strict=True))
        ]
        shown = [part for parts in joblib.Parallel(n_jobs=jobs)(calls) for part in parts]
        return mirrored(joined(shown))._replace(flown=int(found.steps.sum()))

    return advise


def seen_along(scenario: Scenario, states: Array, actions: NDArray[Any], step: int = 0, hoops_passed: int = 0) -> Shown:
    """Return what is seen and done along states (K+1, 5) under actions (K, 2), from that step and hoop on."""
    count = len(actions)
    passed = hoops_along(scenario, states, actions, hoops_passed)[:-1]
    steps = np.minimum(step + np.arange(count), scenario.max_steps - 1)
    situation = Situation(states[:-1], steps, passed, np.zeros(count, dtype=np.int64))
    return Shown(
        task.observe(Scene.of([scenario] * count), situation), np.asarray(actions, dtype=np.float32), asked=count
    )


def brought_back(scenario: Scenario, states: Array, passed: Integers, steps: Integers) -> Shown:
    """Return what the cascaded controller would do in states (n, 5) after steps (n,) with hoops passed (n,).

    Every THIRD of them is shown: it is the same for long.
    """
    steps = np.minimum(steps, scenario.max_steps - 1)[::THIRD]
    if not len(steps):
        return joined([])
    situation = Situation(states[::THIRD], steps, passed[::THIRD], np.zeros(len(steps), dtype=np.int64))
    seen = task.observe(Scene.of([scenario] * len(steps)), situation)
    return Shown(seen, Cascade(scenario.quadrotor).predict(seen)[0], asked=len(steps))


def backwards(scenario: Scenario, states: Array, actions: NDArray[Any]) -> tuple[Scenario, Array, NDArray[Any]]:
    """Return a flight backwards in time - the same thrust, tilt and path, the rate reversed - and where it is one.

    Args:
        scenario: what is flown.
        states: shape (K+1, 5).
        actions: shape (K, 2).
    """
    hoops = tuple(replace(hoop, angle=hoop.angle + np.pi) for hoop in scenario.hoops[::-1])
    turned = replace(scenario, start=scenario.goal, goal=scenario.start, hoops=hoops)
    return turned, states[::-1] * (1, 1, -1, -1, 1), actions[::-1] * np.array([1, -1], dtype=actions.dtype)


def hoops_along(scenario: Scenario, states: Array, actions: NDArray[Any], passed: int = 0) -> Integers:
    """Return the hoops passed at states (K+1, 5) along a flight under actions (K, 2), `passed` of them before."""
    return np.append(passed, judged(scenario, states, actions, passed).hoops_passed)
