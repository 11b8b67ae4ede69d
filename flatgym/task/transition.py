"""Transition of the task for n vehicles: initial state, one step, outcome.

    before = initial(scene)
    after = advance(scene, before, controls)    # n vehicles, one step each
    observe(scene, after), reward(scene, before, after, shaped=True)

The functions are pure. Environments, planners and custom loops share them.
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
"""Depth below the floor or above the ceiling up to which there is no contact [m], so a vehicle may rest on it."""


def initial(scene: Scene) -> EpisodeState:
    """Return n episodes at their starts: at rest, upright, no hoop passed."""
    n = len(scene)
    state = np.zeros((n, 5))
    state[:, 0:2] = scene.start
    nothing = np.zeros(n, dtype=np.int64)
    return EpisodeState(state=state, steps=nothing, hoops_passed=nothing, outcome=nothing)


def advance(scene: Scene, episode: EpisodeState, control: Array) -> EpisodeState:
    """Return the episodes after one step of dt under constant controls [thrust, rate], shape (n, 2).

    The thrust acts multiplied by `scene.thrust_factor`. Limits of the control are not applied here.
    """
    acting = np.stack([control[:, 0] * scene.thrust_factor, control[:, 1]], axis=-1)
    arc = Arc(scene.quadrotor, episode.state, acting, scene.dt, scene.wind)
    after = EpisodeState(
        state=arc.at(scene.dt),
        steps=episode.steps + 1,
        hoops_passed=_pass_hoops(scene, arc, episode.hoops_passed),
        outcome=episode.outcome,
    )
    return replace(after, outcome=outcome(scene, arc, after))


def outcome(scene: Scene, arc: Arc, after: EpisodeState) -> Integers:
    """Return the outcomes after a step along `arc`, indices into OUTCOMES, shape (n,).

    Contact within the step takes precedence over out of bounds, that over the goal, that over the time limit.
    """
    x, z = after.state[:, 0], after.state[:, 1]
    low_x, low_z, high_x, high_z = scene.bounds.T
    code = np.where(after.steps >= scene.last_step, TIME_LIMIT, FLYING)
    code = np.where(arrived(scene, after), GOAL, code)
    code = np.where((x < low_x) | (x > high_x) | (z < low_z) | (z > high_z), OUT_OF_BOUNDS, code)
    up = np.array([0.0, 1.0])
    for direction, limit, contact in ((-up, -scene.ceiling, CEILING), (up, scene.floor, FLOOR)):
        near = z * direction[1] - arc.reach < limit
        if near.any():
            touches = arc[near].lowest(direction) < limit[near] - CONTACT_SLACK
            code[near] = np.where(touches, contact, code[near])
    if scene.quadrotor.radius > 0:
        code = np.where(_touches_rim(scene, arc), COLLISION, code)
    return code


def arrived(scene: Scene, episode: EpisodeState) -> NDArray[np.bool_]:
    """Return whether all hoops are passed and the state is within the tolerance of the goal, shape (n,)."""
    offset, velocity = episode.state[:, 0:2] - scene.goal, episode.state[:, 2:4]
    theta, tolerance = episode.state[:, 4], scene.tolerance
    return (
        (np.hypot(offset[:, 0], offset[:, 1]) <= tolerance.position)
        & (np.hypot(velocity[:, 0], velocity[:, 1]) <= tolerance.speed)
        & (np.abs(nearest_turn(theta)) <= tolerance.angle)
        & (episode.hoops_passed >= scene.hoop_count)
    )


def _pass_hoops(scene: Scene, arc: Arc, passed: Integers) -> Integers:
    """Return the number of hoops passed after the arc, shape (n,); one step may pass several, in order."""
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
        # After a crossing beside the gap the path may cross again; after a passage the next hoop may follow.
        rows, when = rows[crosses], when[crosses]
        time[rows] = when
    return passed


def _touches_rim(scene: Scene, arc: Arc) -> NDArray[np.bool_]:
    """Return whether the body touches an end of any gap within the step, shape (n,)."""
    touched, radius = np.zeros(len(arc), dtype=bool), scene.quadrotor.radius
    for j in range(scene.hoop_centre.shape[1]):
        direction = scene.hoop_direction[:, j]
        across = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
        for side in (-0.5, 0.5):
            rim = scene.hoop_centre[:, j] + side * scene.hoop_diameter[:, j, None] * across
            touched |= (arc.distance(rim, radius) < radius) & (j < scene.hoop_count)
    return touched
