"""The task as pure verbs over a batch: initial, advance, outcome, observe, reward.

    situation = initial(scene)
    situation = advance(scene, situation, controls)    # n vehicles, one step each
    observe(scene, situation), reward(scene, before, after)

Nothing here remembers anything, so that loops, environments and planners share one truth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.arc import Arc
from flatgym.potential import potential
from flatgym.quadrotor import STATE_NAMES, Array
from flatgym.scenario import Scenario
from flatgym.scene import (
    CEILING,
    COLLISION,
    FLOOR,
    FLYING,
    GOAL,
    OUT_OF_BOUNDS,
    OUTCOMES,
    TIME_LIMIT,
    Integers,
    Scene,
    Situation,
)

CONTACT_SLACK = 1e-6
"""Depth below a floor or above a ceiling that is not yet contact [m]: standing on it is allowed."""

HOOPS_SEEN = 2
OBSERVATION_NAMES = (
    "goal_x",
    "goal_z",
    "velocity_x",
    "velocity_z",
    "sin_theta",
    "cos_theta",
    *(
        f"hoop{i}_{what}"
        for i in range(1, HOOPS_SEEN + 1)
        for what in ("x", "z", "direction_x", "direction_z", "diameter")
    ),
    "floor",
    "ceiling",
    "time",
)
"""What each component of an observation is; FlatQuadEnv documents the scales."""

LENGTH_UNIT, SPEED_UNIT = 2.0, 4.0
"""Length [m] and speed [m/s] that are seen as one half."""
FAR = 1e12
"""Length instead of infinity, so that it is seen as 1 [m]."""
OBSERVATIONS = {"features": OBSERVATION_NAMES, "state": STATE_NAMES}
"""What can be observed, and the names of its components."""


def observation_names(observation: str = "features") -> tuple[str, ...]:
    """Return the names of the components of an observation, "features" or "state"."""
    if not isinstance(observation, str) or observation not in OBSERVATIONS:
        raise ValueError(f"unknown observation {observation!r}; known: {', '.join(OBSERVATIONS)}")
    return OBSERVATIONS[observation]


def initial(scene: Scene) -> Situation:
    """Return all vehicles at rest and upright at their starts."""
    n = len(scene)
    state = np.zeros((n, 5))
    state[:, 0:2] = scene.start
    nothing = np.zeros(n, dtype=np.int64)
    return Situation(state=state, steps=nothing, hoops_passed=nothing, outcome=nothing)


def advance(scene: Scene, situation: Situation, control: Array) -> Situation:
    """Fly every vehicle one step of dt under its constant control [thrust, rate], shape (n, 2)."""
    felt = np.stack([control[:, 0] * scene.thrust_factor, control[:, 1]], axis=-1)
    arc = Arc(scene.quadrotor, situation.state, felt, scene.dt, scene.wind)
    after = Situation(
        state=arc.at(scene.dt),
        steps=situation.steps + 1,
        hoops_passed=_pass_hoops(scene, arc, situation.hoops_passed),
        outcome=situation.outcome,
    )
    return replace(after, outcome=outcome(scene, arc, after))


def fly_actions(scenario: Scenario, actions: NDArray[Any]) -> list[Situation]:
    """Fly actions (K, 2) from the scenario's start; return the situations, from the start to the end of the flight.

    The list is shorter than K + 1 when the flight ends before the last action.
    """
    scene = Scene.of([scenario])
    situations = [replace(initial(scene), state=scenario.start_state[None])]
    for action in actions:
        if situations[-1].outcome[0] != FLYING:
            break
        situations.append(advance(scene, situations[-1], scenario.quadrotor.control(action)[None]))
    return situations


def outcome(scene: Scene, arc: Arc, after: Situation) -> Integers:
    """Return how the flights stand after the step flown along `arc`, shape (n,), as in OUTCOMES.

    A contact anywhere inside the step comes before the goal at its end, and the goal before the
    end of the time limit.
    """
    x, z = after.state[:, 0], after.state[:, 1]
    low_x, low_z, high_x, high_z = scene.bounds.T
    code = np.where(after.steps >= scene.last_step, TIME_LIMIT, FLYING)
    code = np.where(arrived(scene, after), GOAL, code)
    code = np.where((x < low_x) | (x > high_x) | (z < low_z) | (z > high_z), OUT_OF_BOUNDS, code)
    up = np.array([0.0, 1.0])
    for direction, limit, word in ((-up, -scene.ceiling, CEILING), (up, scene.floor, FLOOR)):
        near = z * direction[1] - arc.reach < limit
        if near.any():
            touches = arc[near].lowest(direction) < limit[near] - CONTACT_SLACK
            code[near] = np.where(touches, word, code[near])
    if scene.quadrotor.radius > 0:
        code = np.where(_touches_rim(scene, arc), COLLISION, code)
    return code


def arrived(scene: Scene, situation: Situation) -> NDArray[np.bool_]:
    """Return whether the vehicles are at the goal, slow, upright, all hoops passed, shape (n,)."""
    offset, velocity = situation.state[:, 0:2] - scene.goal, situation.state[:, 2:4]
    theta, tolerance = situation.state[:, 4], scene.tolerance
    return (
        (np.hypot(offset[:, 0], offset[:, 1]) <= tolerance.position)
        & (np.hypot(velocity[:, 0], velocity[:, 1]) <= tolerance.speed)
        & (np.abs(theta - 2 * np.pi * np.round(theta / (2 * np.pi))) <= tolerance.angle)
        & (situation.hoops_passed >= scene.hoop_count)
    )


def _pass_hoops(scene: Scene, arc: Arc, passed: Integers) -> Integers:
    """Return the hoops passed after the arc, in order, several in one step if it comes to that."""
    passed, time, reach = passed.copy(), np.zeros(len(arc)), arc.reach
    rows = np.arange(len(arc))
    while rows.size:
        rows = rows[passed[rows] < scene.hoop_count[rows]]
        centre = scene.hoop_centre[rows, passed[rows]]
        near = np.hypot(*(arc.state[rows, 0:2] - centre).T) <= reach[rows] + scene.hoop_diameter[rows, passed[rows]]
        rows, centre = rows[near], centre[near]
        direction = scene.hoop_direction[rows, passed[rows]]
        gap = scene.hoop_diameter[rows, passed[rows]] / 2 - scene.quadrotor.radius
        sub = arc[rows]
        when = sub.crossing(centre, direction, time[rows])
        crosses = ~np.isnan(when)
        offset = sub.at(np.where(crosses, when, 0.0))[:, 0:2] - centre
        aside = np.abs(offset[:, 1] * direction[:, 0] - offset[:, 0] * direction[:, 1])
        passed[rows] += crosses & (aside <= gap)
        # Who crossed beside the gap may cross again, who passed may meet the next hoop.
        rows, when = rows[crosses], when[crosses]
        time[rows] = when
    return passed


def _touches_rim(scene: Scene, arc: Arc) -> NDArray[np.bool_]:
    """Return whether the body touches an end of any hoop's gap during the step, shape (n,)."""
    touched, radius = np.zeros(len(arc), dtype=bool), scene.quadrotor.radius
    for j in range(scene.hoop_centre.shape[1]):
        direction = scene.hoop_direction[:, j]
        across = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
        for side in (-0.5, 0.5):
            rim = scene.hoop_centre[:, j] + side * scene.hoop_diameter[:, j, None] * across
            touched |= (arc.distance(rim, radius) < radius) & (j < scene.hoop_count)
    return touched


def _squash(length: Array, unit: float) -> Array:
    """Return length / (unit + |length|): fine near zero, 1/2 at the unit, never quite 1 but for what is infinite."""
    length = np.minimum(length, FAR)
    return length / (unit + np.abs(length))


def observe(scene: Scene, situation: Situation, observation: str = "features") -> NDArray[np.float32]:
    """Return the features named in OBSERVATION_NAMES, all in [-1, 1], shape (n, 19), or the states, shape (n, 5)."""
    if observation == "state":
        return situation.state.astype(np.float32)
    state, n = situation.state, len(scene)
    x, z, theta = state[:, 0], state[:, 1], state[:, 4]
    columns = np.zeros((len(OBSERVATION_NAMES), n))
    columns[0:2] = _squash(scene.goal - state[:, 0:2], LENGTH_UNIT).T
    columns[2:4] = _squash(state[:, 2:4], SPEED_UNIT).T
    columns[4], columns[5] = np.sin(theta), np.cos(theta)
    for i in range(min(HOOPS_SEEN, scene.hoop_centre.shape[1])):
        ahead = np.flatnonzero(situation.hoops_passed + i < scene.hoop_count)
        which = situation.hoops_passed[ahead] + i
        centre, direction = scene.hoop_centre[ahead, which], scene.hoop_direction[ahead, which]
        row = 6 + 5 * i
        columns[row, ahead] = _squash(centre[:, 0] - x[ahead], LENGTH_UNIT)
        columns[row + 1, ahead] = _squash(centre[:, 1] - z[ahead], LENGTH_UNIT)
        columns[row + 2 : row + 4, ahead] = direction.T
        columns[row + 4, ahead] = _squash(scene.hoop_diameter[ahead, which], LENGTH_UNIT)
    columns[-3] = _squash(z - scene.floor, LENGTH_UNIT)
    columns[-2] = _squash(scene.ceiling - z, LENGTH_UNIT)
    columns[-1] = np.minimum(situation.steps / scene.max_steps, 1.0)
    return np.ascontiguousarray(columns.T, dtype=np.float32)


def reward(scene: Scene, before: Situation, after: Situation, shaped: bool) -> Array:
    """Return the reward of the step from `before` to `after` [s], shape (n,).

    Sparse: minus dt; a flight that fails pays the rest of its time limit at once, so that the
    return is minus the flight time on success and minus the time limit otherwise. Shaped adds
    the difference of the potential; summed over an episode it is a constant of the start, so
    the optimal policy stays the same (Ng, Harada and Russell 1999, with discount 1).
    """
    failed = after.terminated & (after.outcome != GOAL)
    rest = (scene.max_steps - after.steps) * scene.dt
    sparse = -scene.dt - np.where(failed, rest, 0.0)
    if not shaped:
        return sparse
    return sparse + potential(scene, after) - potential(scene, before)


def info(scene: Scene, situation: Situation) -> dict[str, Any]:
    """Return the info arrays, the same keys at every step, each with leading axis n."""
    return {
        "state": situation.state,
        "time": situation.steps * scene.dt,
        "steps": situation.steps,
        "hoops_passed": situation.hoops_passed,
        "is_success": situation.outcome == GOAL,
        "outcome": np.array(OUTCOMES, dtype=object)[situation.outcome],
    }
