"""The task as pure verbs over a batch: initial, advance, outcome, observe, reward.

    situation = initial(scene)
    situation = advance(scene, situation, controls)    # n vehicles, one step each
    observe(scene, situation), reward(scene, before, after)

Nothing here remembers anything, so that loops, environments and planners share one truth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flatgym.arc import Arc
from flatgym.quadrotor import Array, nearest_turn
from flatgym.task.scene import (
    CEILING,
    COLLISION,
    FLOOR,
    FLYING,
    GOAL,
    OUT_OF_BOUNDS,
    TIME_LIMIT,
    EpisodeState,
    Integers,
    Scene,
)

CONTACT_SLACK = 1e-6
"""Depth below a floor or above a ceiling that is not yet contact [m]: standing on it is allowed."""


def initial(scene: Scene) -> EpisodeState:
    """Return all vehicles at rest and upright at their starts."""
    n = len(scene)
    state = np.zeros((n, 5))
    state[:, 0:2] = scene.start
    nothing = np.zeros(n, dtype=np.int64)
    return EpisodeState(state=state, steps=nothing, hoops_passed=nothing, outcome=nothing)


def advance(scene: Scene, episode: EpisodeState, control: Array) -> EpisodeState:
    """Fly every vehicle one step of dt under its constant control [thrust, rate], shape (n, 2)."""
    felt = np.stack([control[:, 0] * scene.thrust_factor, control[:, 1]], axis=-1)
    arc = Arc(scene.quadrotor, episode.state, felt, scene.dt, scene.wind)
    after = EpisodeState(
        state=arc.at(scene.dt),
        steps=episode.steps + 1,
        hoops_passed=_pass_hoops(scene, arc, episode.hoops_passed),
        outcome=episode.outcome,
    )
    return replace(after, outcome=outcome(scene, arc, after))


def outcome(scene: Scene, arc: Arc, after: EpisodeState) -> Integers:
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


def arrived(scene: Scene, episode: EpisodeState) -> NDArray[np.bool_]:
    """Return whether the vehicles are at the goal, slow, upright, all hoops passed, shape (n,)."""
    offset, velocity = episode.state[:, 0:2] - scene.goal, episode.state[:, 2:4]
    theta, tolerance = episode.state[:, 4], scene.tolerance
    return (
        (np.hypot(offset[:, 0], offset[:, 1]) <= tolerance.position)
        & (np.hypot(velocity[:, 0], velocity[:, 1]) <= tolerance.speed)
        & (np.abs(nearest_turn(theta)) <= tolerance.angle)
        & (episode.hoops_passed >= scene.hoop_count)
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
