"""Transition of the task for n vehicles: initial state, one step, outcome.

    before = initial(scene)
    after = advance(scene, before, controls)    # n vehicles, one step each
    observe(scene, after), reward(scene, before, after, shaped=True)

The functions are pure. Environments, planners and custom loops share them. They take arrays of NumPy, PyTorch or JAX,
those of one call from one library and on one device, and compile under `jax.jit` and `torch.compile`. The state after a
step is a smooth function of state and control. Hoops passed and outcomes are integers: no gradient flows through them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from flatgym.arc import Arc
from flatgym.arrays import check_arrays, hypot, namespace, on_device_of, repeat, where_rare
from flatgym.quadrotor import nearest_turn
from flatgym.task.scene import (
    CEILING,
    COLLISION,
    FLOOR,
    FLYING,
    GOAL,
    OUT_OF_BOUNDS,
    TIME_LIMIT,
    EpisodeState,
    Scene,
)

CONTACT_SLACK = 1e-6
"""Depth below the floor or above the ceiling up to which there is no contact [m], so a vehicle may rest on it."""


def initial(scene: Scene) -> EpisodeState:
    """Return n episodes at their starts: at rest, upright, no hoop passed."""
    xp = namespace(scene.start)
    still = xp.zeros_like(scene.start[:, :1])
    state = xp.concat([scene.start, still, still, still], axis=1)
    # Three arrays: JAX donates no buffer twice.
    steps, passed, code = (xp.zeros_like(scene.hoop_count) for _ in range(3))
    return EpisodeState(state=state, steps=steps, hoops_passed=passed, outcome=code)


def advance(scene: Scene, episode: EpisodeState, control: Any) -> EpisodeState:
    """Return the episodes after one step of dt under constant controls [thrust, rate], shape (n, 2).

    The thrust acts multiplied by `scene.thrust_factor`. Limits of the control are not applied here. A control that is
    not finite ends the episode out of bounds, with the vehicle where it was.

    Raises:
        TypeError: for arrays of different libraries, and for states that are not float64 or float32.
        ValueError: for arrays on different devices.
    """
    xp = namespace(episode.state, control, scene.start)
    check_arrays(state=episode.state, scene=scene.start, control=control)
    control = xp.astype(control, episode.state.dtype, copy=False)
    usable = xp.all(xp.isfinite(control), axis=-1)
    acting = xp.stack([control[:, 0] * scene.thrust_factor, control[:, 1]], axis=-1)
    acting = xp.where(usable[:, None], acting, xp.zeros_like(acting))
    arc = Arc(scene.quadrotor, episode.state, acting, scene.dt, scene.wind)
    after = EpisodeState(
        state=xp.where(usable[:, None], arc.at(scene.dt), episode.state),
        steps=episode.steps + 1,
        hoops_passed=xp.where(usable, _pass_hoops(scene, arc, episode.hoops_passed), episode.hoops_passed),
        outcome=episode.outcome,
    )
    code = outcome(scene, arc, after)
    return replace(after, outcome=xp.where(usable, code, xp.full_like(code, OUT_OF_BOUNDS)))


def outcome(scene: Scene, arc: Arc, after: EpisodeState) -> Any:
    """Return the outcomes after a step along `arc`, indices into OUTCOMES, shape (n,).

    Contact within the step takes precedence over out of bounds, that over the goal, that over the time limit.
    """
    xp, arc = namespace(after.state), arc.constant
    x, z, code = after.state[:, 0], after.state[:, 1], xp.full_like(after.steps, FLYING)

    def put(code: Any, where: Any, value: int) -> Any:
        return xp.where(where, xp.full_like(code, value), code)

    low_x, low_z, high_x, high_z = (scene.bounds[:, i] for i in range(4))
    inside = (x >= low_x) & (x <= high_x) & (z >= low_z) & (z <= high_z)
    code = put(code, after.steps >= scene.last_step, TIME_LIMIT)
    code = put(code, arrived(scene, after), GOAL)
    code = put(code, ~inside, OUT_OF_BOUNDS)
    for up, limit, contact in ((-1.0, -scene.ceiling, CEILING), (1.0, scene.floor, FLOOR)):
        code = put(code, _touches_line(arc, up, z, limit), contact)
    if scene.quadrotor.radius > 0 and scene.hoop_diameter.shape[1]:
        code = put(code, _touches_rim(scene, arc), COLLISION)
    return code


def arrived(scene: Scene, episode: EpisodeState) -> Any:
    """Return whether all hoops are passed and the state is within the tolerance of the goal, shape (n,)."""
    offset, velocity = episode.state[:, 0:2] - scene.goal, episode.state[:, 2:4]
    theta, tolerance = episode.state[:, 4], scene.tolerance
    return (
        (hypot(offset[:, 0], offset[:, 1]) <= tolerance.position)
        & (hypot(velocity[:, 0], velocity[:, 1]) <= tolerance.speed)
        & (abs(nearest_turn(theta)) <= tolerance.angle)
        & (episode.hoops_passed >= scene.hoop_count)
    )


def passage(scene: Scene, episode: EpisodeState, control: Any) -> tuple[Any, Any]:
    """Return when and where the paths of the next step first cross the lines of their next hoops.

    Unlike the number of hoops passed, both have gradients. Arguments as for `advance`.

    Returns:
        The time within the step [s] and the place along the gap, signed, 0 at its centre [m], each of shape (n,); nan
        without a crossing in the direction of passage, and without a hoop ahead.
    """
    (n, most), xp = scene.hoop_diameter.shape, namespace(episode.state, control, scene.start)
    if not most:
        nowhere = xp.full_like(episode.state[:, 0], xp.nan)
        return nowhere, nowhere
    acting = xp.stack([control[:, 0] * scene.thrust_factor, control[:, 1]], axis=-1)
    arc = Arc(scene.quadrotor, episode.state, acting, scene.dt, scene.wind)
    rows, which = xp.arange(n, **on_device_of(episode.state)), xp.clip(episode.hoops_passed, 0, most - 1)
    centre, direction = scene.hoop_centre[rows, which], scene.hoop_direction[rows, which]
    when = arc.crossing(centre, direction, xp.zeros_like(arc.dt))
    crosses = ~xp.isnan(when) & (episode.hoops_passed < scene.hoop_count)
    aside = _aside(arc, centre, direction, xp.where(crosses, when, xp.zeros_like(when)))
    return xp.where(crosses, when, xp.nan), xp.where(crosses, aside, xp.nan)


def _aside(arc: Arc, centre: Any, direction: Any, time: Any) -> Any:
    """Return the place along gaps at times within the step [m], shape (n,)."""
    x, z = arc.components(time)[:2]
    return (z - centre[:, 1]) * direction[:, 0] - (x - centre[:, 0]) * direction[:, 1]


def _pass_hoops(scene: Scene, arc: Arc, passed: Any) -> Any:
    """Return the number of hoops passed after the arc, shape (n,); one step may pass several, in order."""
    (n, most), xp, arc = scene.hoop_diameter.shape, arc.xp, arc.constant
    if not most:
        return passed
    reach, half = arc.reach, scene.hoop_diameter / 2 - scene.quadrotor.radius
    rows = xp.arange(n, **on_device_of(passed))
    nowhere = xp.full((n, 2), xp.nan, dtype=arc.state.dtype, **on_device_of(passed))

    def cross(centre: Any, direction: Any, gap: Any, after: Any, *arrays: Any) -> Any:
        """Return the time of crossing, and whether it is through the gap, shape (m, 2)."""
        part = Arc(scene.quadrotor, *arrays)
        when = part.crossing(centre, direction, after)
        aside = _aside(part, centre, direction, xp.where(xp.isnan(when), xp.zeros_like(when), when))
        return xp.stack([when, xp.where(abs(aside) <= gap, xp.ones_like(when), xp.zeros_like(when))], axis=-1)

    def search(passed: Any, after: Any, live: Any) -> tuple[Any, ...]:
        which = xp.clip(passed, 0, most - 1)
        centre, direction, gap = scene.hoop_centre[rows, which], scene.hoop_direction[rows, which], half[rows, which]
        away = hypot(arc.state[:, 0] - centre[:, 0], arc.state[:, 1] - centre[:, 1])
        live = live & (passed < scene.hoop_count) & (away <= reach + scene.hoop_diameter[rows, which])
        found = where_rare(live, cross, nowhere, centre, direction, gap, after, *arc.arrays)
        when, through = found[:, 0], found[:, 1] > 0
        crosses = ~xp.isnan(when)
        # After a crossing beside the gap the path may cross again; after a passage the next hoop may follow.
        passed = xp.where(crosses & through, passed + 1, passed)
        return passed, xp.where(crosses, when, after), crosses

    live = passed < scene.hoop_count
    return repeat(lambda *now: xp.any(now[2]), search, passed, xp.zeros_like(reach), live)[0]


def _touches_line(arc: Arc, up: float, height: Any, limit: Any) -> Any:
    """Return whether `up * z` falls below a limit within the step, shape (n,)."""

    def touches(limit: Any, *arrays: Any) -> Any:
        part = Arc(arc.quadrotor, *arrays)
        direction = arc.xp.stack([arc.xp.zeros_like(limit), arc.xp.full_like(limit, up)], axis=-1)
        return part.lowest(direction) < limit - CONTACT_SLACK

    near = up * height - arc.reach < limit
    return where_rare(near, touches, arc.xp.zeros_like(near), limit, *arc.arrays)


def _touches_rim(scene: Scene, arc: Arc) -> Any:
    """Return whether the body touches an end of any gap within the step, shape (n,)."""
    xp, radius, most = arc.xp, scene.quadrotor.radius, scene.hoop_diameter.shape[1]
    centre, direction = (xp.moveaxis(points, 1, 0) for points in (scene.hoop_centre, scene.hoop_direction))
    across = xp.stack([-direction[..., 1], direction[..., 0]], axis=-1)
    half = scene.hoop_diameter.T[..., None] / 2 * across
    rims = xp.concat([centre - half, centre + half])  # (2 most, n, 2)
    exists = xp.arange(most, **on_device_of(arc.state))[:, None] < scene.hoop_count
    return xp.any(xp.concat([exists, exists]) & (arc.distance(rims, radius) < radius), axis=0)
