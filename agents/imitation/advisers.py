"""Advice: what an expert would have done where a learner came to - the half of DAgger that knows the optimum.

On one scenario the expert is the regulator about its optimal flight, and advises at every step. On a distribution
every flight has a regulator of its own. Their advice is cheap, and leads through the hoops; but how to reach the goal
soonest from where a learner comes out of the last hoop only planning anew tells, and there it takes milliseconds. Who
has missed a hoop, or is far from any flight that is known, is shown the way back by the cascaded controller, which is
slow but gets there. It is shown nowhere else, or learners would become as slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.lqr import tolerances
from agents.controllers.mpc import continuations
from agents.controllers.tracking import TrackingControllers
from agents.evaluation.rollouts import fly
from agents.imitation.dataset import Shown, joined, mirrored
from agents.imitation.dataset_aggregation import ExpertOracle
from agents.policies.policy import Policy
from flatgym import task
from flatgym.quadrotor import Array
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.scenario import Scenario, Tolerance
from flatgym.task.rollout import episode_outcomes
from flatgym.task.scene import FLYING, EpisodeState, Integers, Scene
from optimal.discrete.fewest_steps import FewestSteps

SCATTER = tolerances(Tolerance())
"""Standard deviations by which starts are scattered, times `scatter` [m, m, m/s, m/s, rad]: the tolerance's."""
ASTRAY = 30.0
"""How far from the expert's flight, in tolerances, a learner is lost."""
LENIENT = 2
"""Points of the expert's flight by which a learner may be late in passing a hoop; later he has missed it."""
THIRD = 3
"""Of hovering at the goal, which may take long, one step in so many is shown."""
CAREFUL = 0.5
"""The share of the tolerance at the goal that plans keep to: it costs a step at most, and a learner may err."""
WINDOW = range(-6, 4)
"""Points of a flight, about the one that is due, the nearest of which a learner in general is advised by."""


def regulated(
    flights: Sequence[FewestSteps],
    *,
    count: int = 32,
    scatter: float = 0.05,
    noise: float = 0.05,
    window: Sequence[int] = (0,),
    rescuer: Policy | None = None,
    beyond: bool = True,
    seed: int = 0,
) -> ExpertOracle:
    """Return the advice of the regulators about optimal flights.

    Args:
        flights: the optimal flights, of scenarios of one vehicle.
        count: flights of a round; of the expert alone all. The first is begun at the very start of the first of
            `flights`, and flown without noise; the others are about flights drawn from among them.
        scatter: how far the others' starts are scattered, as a factor on SCATTER.
        noise: standard deviation of the noise on the actions of half of them.
        window: as in `TrackingControllers`.
        rescuer: who advises those that are lost: after a missed hoop until the last one is passed, and where the
            expert's flight is too far. Without one their flights are given up.
        beyond: whether a learner is advised behind the last hoop too, where the regulator leads him back to the flight
            he knows, and not to the goal soonest; those that are lost there are.
        seed: of choice, scatter and noise.
    """
    experts = TrackingControllers(flights, window)
    due = experts.hoops_passed()

    def advise(learner: PPO | None, number: int) -> Shown:
        generator = np.random.default_rng((seed, number))
        size = max(count, len(flights)) if learner is None else count
        which = np.append(0, generator.permutation(np.arange(1, max(size, len(flights))))[: size - 1] % len(flights))
        scene, start = Scene.of([flights[i].scenario for i in which]), experts.states[which, 0]
        start[1:] += scatter * SCATTER * generator.normal(size=(size - 1, 5))
        start[:, 1] = np.clip(start[:, 1], scene.floor, scene.ceiling)
        none, spread = np.zeros(size, dtype=np.int64), noise * (np.arange(size) % 2)[:, None]
        situation, point = EpisodeState(start, none, none, none), none - 1
        flying, missed, seen, told, flown = none == 0, none > 0, [], [], 0
        while True:
            point, off, distance = experts.nearest(which, situation.state, point)
            missed |= situation.hoops_passed < due[which, np.maximum(point - LENIENT, 0)]
            lost = (missed & (situation.hoops_passed < scene.hoop_count)) | (distance >= ASTRAY)
            flying &= (situation.outcome == FLYING) & ~(lost & (rescuer is None))
            if not flying.any():
                break
            observations, advice = task.observe(scene, situation), experts.action(which, point, off)
            if rescuer is not None:
                advice = np.where(lost[:, None], rescuer.predict(observations)[0], advice)
            hovers, through = point == experts.last[which], situation.hoops_passed == scene.hoop_count
            left_out = (hovers & (situation.steps % THIRD > 0)) | (through & (not beyond) & (learner is not None))
            wanted = flying & (lost | ~left_out)
            seen.append(observations[wanted])
            told.append(advice[wanted])
            flown += int(flying.sum())
            actions = advice if learner is None else learner.predict(observations, deterministic=True)[0]
            actions = np.clip(actions + spread * generator.normal(size=actions.shape), -1, 1)
            situation = task.advance(scene, situation, scene.quadrotor.control(actions))
        shown = joined([Shown(*both, asked=len(both[0])) for both in zip(seen, told, strict=True)])
        return shown._replace(flown=0 if learner is None else flown)

    return advise


def guided(
    flights: Sequence[FewestSteps],
    distribution: Distribution,
    *,
    count: int = 1600,
    planned: int = 200,
    every: int = 5,
    ahead: int = 30,
    weight: int = 3,
    seed: int = 0,
    jobs: int = -1,
) -> ExpertOracle:
    """Return the advice of all who know a part of a drawn scenario, on flights through such; in a mirror too.

    The regulators about the optimal flights, these being flown backwards in time as well, and the cascaded controller
    for those that are lost; behind the last hoop, as long as it takes, whoever plans anew.

    Args:
        flights: optimal flights of `distribution.scenario(i)`, i = 0, 1, ..., or of the same with narrower hoops.
        distribution: from which they are drawn.
        count: flights of a round with a regulator.
        planned: flights of a round from which it is planned anew.
        every: steps between plans.
        ahead: steps of a plan that are shown.
        weight: how often a plan counts.
        seed: of scatter and noise.
        jobs: worker processes.
    """
    own = [replace(flight, scenario=distribution.scenario(i)) for i, flight in enumerate(flights)]
    rescuer = CascadedPD(distribution.quadrotor)
    about = regulated(
        [*own, *map(backwards, own)],
        count=count,
        scatter=0.3,
        window=WINDOW,
        rescuer=rescuer,
        beyond=False,
        seed=seed,
    )

    def advise(learner: PPO | None, number: int) -> Shown:
        if learner is None:
            return mirrored(about(None, number))
        first = (number * planned) % max(1, len(own) - planned)
        flown = fly(learner, distribution, min(planned, len(own)), first)
        calls = (
            joblib.delayed(corrected)(flight, states, actions, every, ahead)
            for flight, states, actions in zip(own[first:], flown.states, flown.actions, strict=False)
        )
        plans = joined(joblib.Parallel(n_jobs=jobs)(calls))._replace(flown=int(flown.steps.sum()))
        again = [plans._replace(flown=0, asked=0)] * (weight - 1)
        return mirrored(joined([about(learner, number), plans, *again]))

    return advise


def corrected(flight: FewestSteps, states: Array, actions: NDArray[np.float32], every: int, ahead: int) -> Shown:
    """Return what should have been done behind the last hoop on another's flight than the scenario's optimal one.

    Args:
        flight: the optimal one.
        states: of the other, shape (K+1, 5).
        actions: of the other, shape (K, 2).
        every, ahead: as in `guided`.
    """
    scenario = flight.scenario
    passed = hoops_along(scenario, states, actions)[:-1]
    through = np.flatnonzero(passed == len(scenario.hoops))
    careful = replace(flight, scenario=replace(scenario, tolerance=stricter(scenario.tolerance)))
    plans = continuations(careful, states[:-1], passed, every, since=int(through[0])) if len(through) else ()
    return joined(
        [
            seen_along(scenario, plan.states[: ahead + 1], plan.actions[:ahead], plan.step, plan.hoops_passed)
            for plan in plans
        ]
    )


def stricter(tolerance: Tolerance) -> Tolerance:
    """Return the tolerance that plans keep to."""
    return Tolerance(*(CAREFUL * value for value in (tolerance.position, tolerance.speed, tolerance.angle)))


def seen_along(scenario: Scenario, states: Array, actions: NDArray[Any], step: int = 0, hoops_passed: int = 0) -> Shown:
    """Return what is seen and done along states (K+1, 5) under actions (K, 2), from that step and hoop on."""
    count = len(actions)
    passed = hoops_along(scenario, states, actions, hoops_passed)[:-1]
    steps = np.minimum(step + np.arange(count), scenario.max_steps - 1)
    situation = EpisodeState(states[:-1], steps, passed, np.zeros(count, dtype=np.int64))
    return Shown(
        task.observe(Scene.of([scenario] * count), situation), np.asarray(actions, dtype=np.float32), asked=count
    )


def backwards(flight: FewestSteps) -> FewestSteps:
    """Return a flight backwards in time, from goal to start: the same thrust, tilt and path, the rate reversed."""
    scenario = flight.scenario
    hoops = tuple(replace(hoop, angle=hoop.angle + np.pi) for hoop in scenario.hoops[::-1])
    turned = replace(scenario, start=scenario.goal, goal=scenario.start, hoops=hoops)
    states = (flight.states - [0, 0, 0, 0, 2 * np.pi * flight.winding])[::-1] * (1, 1, -1, -1, 1)
    actions = flight.actions[::-1] * np.array([1, -1], dtype=np.float32)
    return replace(flight, scenario=turned, states=states, actions=actions, winding=-flight.winding)


def hoops_along(scenario: Scenario, states: Array, actions: NDArray[Any], passed: int = 0) -> Integers:
    """Return the hoops passed at states (K+1, 5) along a flight under actions (K, 2), `passed` of them before."""
    return np.append(passed, episode_outcomes(scenario, states, actions, passed).hoops_passed)
