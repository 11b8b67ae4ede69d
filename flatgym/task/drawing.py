"""Scenes of sampled scenarios: the same task for a seed and an episode in every library.

`Distribution.draw` and `Disturbances.draw` sample for NumPy. `draw` does the same for PyTorch and JAX, on their device,
by the same code (`flatgym.scenarios.layouts`) and the same generator (`flatgym.scenarios.counter_words`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import FunctionType
from typing import Any

from flatgym.arrays import like, namespace, on_device_of
from flatgym.scenarios.catalogue import Problem
from flatgym.scenarios.counter_rng import DISTURBANCE, NOISE, SCENE
from flatgym.scenarios.counter_words import Words, normal, uniform
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.disturbances import Disturbances, write_disturbances
from flatgym.scenarios.layouts import PER_HOOP, PLACED, uniforms_needed, write_line, write_track
from flatgym.scenarios.scenario import BOUNDS_MARGIN
from flatgym.task.scene import Scene


def draw(problem: Problem, seed: Words, episode: Words, dtype: Any, disturbances: Disturbances | None = None) -> Scene:
    """Return the scene of n episodes in PyTorch or JAX.

    Args:
        problem: the scenario, or the distribution from which to sample.
        seed, episode: words of shape (n,), see `counter_words.words`; they determine library and device.
        dtype: float64 or float32 of the library.
        disturbances: sampled as well.
    """
    xp, n = namespace(seed[0]), seed[0].shape[0]
    where = on_device_of(seed[0])
    if isinstance(problem, Distribution):
        scene = placed_scene(problem, draw_rows(problem, seed, episode, dtype))
    else:
        scene = Scene.of([problem]).repeat(n).to(xp, dtype, where.get("device"))
    if disturbances is None or not disturbances.active:
        return scene
    u = [uniform(seed, episode, DISTURBANCE + i, dtype) for i in range(5)]
    drawn: list[Any] = [None] * 4
    strengths = disturbances.wind, disturbances.thrust_gain, disturbances.mass, float(disturbances.action_delay)
    in_library(write_disturbances, xp)(u, *strengths, drawn)
    factor, wind_x, wind_z, delay = drawn
    wind = xp.stack([wind_x, wind_z], axis=-1)
    return replace(scene, thrust_factor=factor, wind=wind, delay=xp.astype(delay, scene.delay.dtype))


def draw_rows(problem: Distribution, seed: Words, episode: Words, dtype: Any) -> Any:
    """Return what `Distribution.draw` returns, in PyTorch or JAX; arguments as for `draw`."""
    xp, most = namespace(seed[0]), problem.hoops[1]
    u = [uniform(seed, episode, SCENE + i, dtype) for i in range(uniforms_needed(most))]
    columns: list[Any] = [None] * (PLACED + PER_HOOP * most)
    in_library(write_line if problem.leg is None else write_track, xp)(u, problem.numbers, columns)
    return xp.stack(columns, axis=-1)


def sensor_noise(disturbances: Disturbances, seed: Words, episode: Words, step: Any, dtype: Any) -> Any:
    """Return what `Disturbances.noise` returns, in PyTorch or JAX; `step` has shape (n,)."""
    xp = namespace(seed[0])
    step = xp.astype(step, seed[0].dtype)
    errors = []
    for i in range(5):
        index = xp.zeros_like(step), NOISE + 2 * i + step * 10
        errors.append(normal(seed, episode, index, dtype))
    return disturbances.sensor_noise * xp.stack(errors, axis=-1)


def placed_scene(problem: Distribution, rows: Any) -> Scene:
    """Return the scene of n sampled scenarios, without disturbances; `rows` as returned by `Distribution.draw`."""
    xp, n, most = namespace(rows), rows.shape[0], problem.hoops[1]
    real, where = like(rows), on_device_of(rows)
    whole = where | {"dtype": xp.asarray(0).dtype}
    goal, count = rows[:, 0:2], xp.astype(rows[:, 2], whole["dtype"])
    hoops = xp.reshape(rows[:, PLACED:], (n, most, PER_HOOP))
    present = xp.arange(most, **where) < count[:, None]
    hoops = xp.where(present[:, :, None], hoops, xp.zeros_like(hoops))
    points = xp.concat([xp.zeros((n, 1, 2), **real), goal[:, None], hoops[:, :, 0:2]], axis=1)
    direction = xp.stack([xp.cos(hoops[:, :, 2]), xp.sin(hoops[:, :, 2])], axis=-1)
    low, high = xp.min(points, axis=1) - BOUNDS_MARGIN, xp.max(points, axis=1) + BOUNDS_MARGIN
    return Scene(
        quadrotor=problem.quadrotor,
        tolerance=problem.tolerance,
        dt=problem.dt,
        start=xp.zeros((n, 2), **real),
        goal=goal,
        hoop_centre=hoops[:, :, 0:2],
        hoop_direction=xp.where(present[:, :, None], direction, xp.zeros_like(direction)),
        hoop_diameter=hoops[:, :, 3],
        hoop_count=count,
        floor=xp.full((n,), -xp.inf, **real),
        ceiling=xp.full((n,), xp.inf, **real),
        bounds=xp.concat([low, high], axis=1),
        max_steps=xp.full((n,), problem.max_steps, **whole),
        last_step=xp.full((n,), problem.max_steps, **whole),
        thrust_factor=xp.ones((n,), **real),
        wind=xp.zeros((n, 2), **real),
        delay=xp.zeros((n,), **whole),
    )


def in_library(function: Callable[..., Any], xp: Any) -> Callable[..., Any]:
    """Return a function whose global name `np` is the namespace of another library.

    The layouts serve NumPy and numba, which cannot take a namespace as an argument.
    """
    assert isinstance(function, FunctionType)
    return FunctionType(function.__code__, function.__globals__ | {"np": xp}, function.__name__)
