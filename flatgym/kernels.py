"""The task for many vehicles at once, compiled: step, hoops, outcome, reward, observation and autoreset in one pass.

The truth is `flatgym.task`; this is the same, written for speed, and a test holds both together. One float64 array
holds everything that flies, in blocks of BLOCK vehicles, each a table of ROWS rows: so a block stays in the nearest
cache while the phases of a step pass over it, the loop over its columns runs in the processor's vector registers
(which is why there are no branches in it), and what is rare - a hoop, a floor, an end - is looked at one by one.

Offsets are unsigned, because an index that might be negative keeps the compiler from using vectors.
"""

from __future__ import annotations

import hashlib
import math
from itertools import count, islice
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.extending import register_jitable

from flatgym.distributions import PER_HOOP, PLACED, TRIES, place
from flatgym.disturbances import affect
from flatgym.draws import DISTURBANCE, NOISE, SCENE, START, mix, normal, uniform
from flatgym.events import at, compiled, crossing, distance, lowest
from flatgym.potential import CRUISE_SPEED, DIRECTIONS
from flatgym.scenario import BOUNDS_MARGIN
from flatgym.scene import CEILING, COLLISION, FLOOR, FLYING, GOAL, OUT_OF_BOUNDS, TIME_LIMIT
from flatgym.task import CONTACT_SLACK, FAR, LENGTH_UNIT, OBSERVATION_NAMES, SPEED_UNIT

BLOCK = 32
_offsets = count(step=BLOCK)


def rows(n: int) -> tuple[np.uint64, ...]:
    """Return the offsets of the next n rows of a block."""
    return tuple(np.uint64(offset) for offset in islice(_offsets, n))


X, Z, VX, VZ, THETA = rows(5)  # the state
MX, _, _, _, _ = rows(5)  # the state as measured
BX, BZ, BVX, BVZ, BTHETA = rows(5)  # the state before the step
THRUST, RATE, FACTOR, PULL_X, PULL_Z, DELAY = rows(6)  # what drives it
START_X, START_Z, GOAL_X, GOAL_Z, COUNT = rows(5)  # the scene
FLOOR_Z, CEILING_Z, LOW_X, LOW_Z, HIGH_X, HIGH_Z = rows(6)
AHEAD1, X1, Z1, DX1, DZ1, GAP1 = rows(6)  # whether there is a next hoop; the hoop, or else the goal
AHEAD2, _, _, _, _, _ = rows(6)  # the same of the hoop after it
WAY, STEPS, PASSED, OUTCOME = rows(4)  # the way from the next hoop on to the goal; how the flight stands
WAITS, POTENTIAL, BEFORE, FLAG = rows(4)  # whether the next step begins anew; the potential, before, and scratch
ROW = tuple(np.uint64(i * BLOCK) for i in range(len(OBSERVATION_NAMES)))
"""Offsets of rows from another."""
OBSERVED = rows(len(ROW))[0]
ROWS = next(_offsets) // BLOCK
SPAN = np.uint64(ROWS * BLOCK)
NONE, ONE, LANES = np.uint64(0), np.uint64(1), np.uint64(BLOCK)


def sources() -> str:
    """Return a digest of the files compiled here.

    Numba's cache on disk does not notice when a function in another file changes. As part of the record's type the
    digest is part of the cache's key.
    """
    folder, digest = Path(__file__).parent, hashlib.sha256()
    for name in ("arc", "distributions", "disturbances", "draws", "events", "kernels", "potential", "scene", "task"):
        digest.update((folder / f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


SETTINGS = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("dt", "thrust_min", "thrust_max", "rate_max", "gravity", "radius"),
            *("position", "speed", "angle", "max_steps"),
            *("wind", "thrust_gain", "mass", "action_delay", "sensor_noise", "share"),
        )
    ]
    + [(name, np.bool_) for name in ("shaped", "features", "drawn", "disturbed", "same_step")]
    + [(f"sources_{sources()}", np.bool_)]
)
"""What an environment is made with, as one record."""

vectors = numba.njit(error_model="numpy", fastmath={"contract", "arcp"})
cached = numba.njit(cache=True, error_model="numpy")
for shared in (mix, uniform, normal, place, affect):
    register_jitable(shared)

QUARTER, QUARTER_REST = math.pi / 2, 6.123233995736766e-17
"""pi/2 as the sum of two numbers."""
_DX, _DZ = tuple(map(float, DIRECTIONS[0])), tuple(map(float, DIRECTIONS[1]))


@vectors
def sine_cosine(angle: float) -> Any:
    """Return sine and cosine by Taylor series about the nearest quarter turn, without branches; error < 1e-15."""
    k = np.floor(angle * (1 / QUARTER) + 0.5)
    r = (angle - k * QUARTER) - k * QUARTER_REST
    q = r * r
    s = r * (1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110 * (1 - q / 156 * (1 - q / 210)))))))
    c = 1 - q / 2 * (
        1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132 * (1 - q / 182 * (1 - q / 240))))))
    )
    k -= 4 * np.floor(k / 4)
    odd = (k == 1.0) | (k == 3.0)
    sine, cosine = (c if odd else s), (s if odd else c)
    return (-sine if k >= 2.0 else sine), (-cosine if (k == 1.0) | (k == 2.0) else cosine)


@vectors
def command(f: Any, o: Any, n: Any, c: Any, actions: Any, first: int) -> None:
    """Turn actions into thrust and rate; clipped to the box."""
    low, high, most = c.thrust_min, c.thrust_max, c.rate_max
    for i in range(n):
        push, turn = actions[first + i, 0], actions[first + i, 1]
        push = (min(max(push, -1.0), 1.0) + 1) / 2
        turn = (min(max(turn, -1.0), 1.0) + 1) / 2
        f[o + THRUST + i] = low * (1 - push) + high * push
        f[o + RATE + i] = -most * (1 - turn) + most * turn


@compiled
def delay(f: Any, o: Any, n: Any, c: Any, pending: Any, first: int) -> None:
    """Put the commands into their queues, and take out those whose time has come; before the first, hover."""
    slots = pending.shape[1]
    for i in range(n):
        queue, step, late = pending[first + i], int(f[o + STEPS + i]), int(f[o + DELAY + i])
        queue[step % slots, 0], queue[step % slots, 1] = f[o + THRUST + i], f[o + RATE + i]
        if late > step:
            f[o + THRUST + i], f[o + RATE + i] = c.gravity, 0.0
        else:
            f[o + THRUST + i], f[o + RATE + i] = queue[(step - late) % slots]


@vectors
def bessel(a: float) -> Any:
    """Return j0(a) and j1(a) for |a| <= pi by their power series, without branches; error < 1e-15."""
    q = a * a
    j0 = 1 - q / 342 * (1 - q / 420 * (1 - q / 506 * (1 - q / 600 * (1 - q / 702 * (1 - q / 812)))))
    j0 = 1 - q / 72 * (1 - q / 110 * (1 - q / 156 * (1 - q / 210 * (1 - q / 272 * j0))))
    j0 = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * j0))
    j1 = 1 - q / 378 * (1 - q / 460 * (1 - q / 550 * (1 - q / 648 * (1 - q / 754))))
    j1 = 1 - q / 88 * (1 - q / 130 * (1 - q / 180 * (1 - q / 238 * (1 - q / 304 * j1))))
    return j0, a / 3 * (1 - q / 10 * (1 - q / 28 * (1 - q / 54 * j1)))


@vectors
def fly(f: Any, o: Any, n: Any, h: float) -> None:
    """Fly the exact step of `flatgym.quadrotor`; no step makes a whole turn, so |rate| h / 2 <= pi."""
    for i in range(n):
        k = o + i
        x, z, vx, vz, theta = f[k + X], f[k + Z], f[k + VX], f[k + VZ], f[k + THETA]
        pull_x, pull_z, rate = f[k + PULL_X], f[k + PULL_Z], f[k + RATE]
        a, dv = rate * h / 2, f[k + THRUST] * f[k + FACTOR] * h
        j0, j1 = bessel(a)
        sine, cosine = sine_cosine(theta + a)
        f[k + BX], f[k + BZ], f[k + BVX], f[k + BVZ], f[k + BTHETA] = x, z, vx, vz, theta
        f[k + X] = x + (vx + pull_x * h / 2) * h + dv * h / 2 * (j0 * sine - j1 * cosine)
        f[k + Z] = z + (vz + pull_z * h / 2) * h + dv * h / 2 * (j0 * cosine + j1 * sine)
        f[k + VX] = vx + dv * j0 * sine + pull_x * h
        f[k + VZ] = vz + dv * j0 * cosine + pull_z * h
        f[k + THETA] = theta + rate * h


@vectors
def suspect(f: Any, o: Any, n: Any, h: float, radius: float) -> None:
    """Mark the vehicles that may have met a hoop, the floor or the ceiling inside the step.

    An arc strays from its chord by at most |p''| h^2 / 8, and |p''| is at most thrust and pull together.
    """
    for i in range(n):
        k = o + i
        bow = f[k + THRUST] * f[k + FACTOR] + abs(f[k + PULL_X]) + abs(f[k + PULL_Z])
        bow = bow * h * h / 8
        dx, dz, x, z = f[k + DX1], f[k + DZ1], f[k + X] - f[k + X1], f[k + Z] - f[k + Z1]
        bx, bz = f[k + BX] - f[k + X1], f[k + BZ] - f[k + Z1]
        along, before = x * dx + z * dz, bx * dx + bz * dz
        aside, aside_before = z * dx - x * dz, bz * dx - bx * dz
        crosses = (min(along, before) - bow < 0) & (max(along, before) + bow >= 0)
        gap = f[k + GAP1] / 2 - radius + bow
        inside = (min(aside, aside_before) <= gap) & (max(aside, aside_before) >= -gap)
        low = min(f[k + Z], f[k + BZ]) - bow < f[k + FLOOR_Z]
        high = max(f[k + Z], f[k + BZ]) + bow > f[k + CEILING_Z]
        f[k + FLAG] = 1.0 if ((f[k + AHEAD1] > 0) & crosses & inside) | low | high else 0.0


@compiled
def arc_of(f: Any, k: Any) -> Any:
    """Return the arc of the step just flown, as `flatgym.events` wants it."""
    thrust = f[k + THRUST] * f[k + FACTOR]
    state = (f[k + BX], f[k + BZ], f[k + BVX], f[k + BVZ], f[k + BTHETA])
    return (*state, thrust, f[k + RATE], f[k + PULL_X], f[k + PULL_Z])


@compiled
def meet(f: Any, k: Any, c: Any, hoops: Any) -> int:
    """Pass the hoops met inside the step, and return the outcome if a rim, the floor or the ceiling was touched."""
    arc, touched, time = arc_of(f, k), FLYING, 0.0
    j, count = int(f[k + PASSED]), int(f[k + COUNT])
    while j < count:
        x, z, dx, dz, gap = hoops[j]
        when = crossing(arc, c.dt, x, z, dx, dz, time)
        if not when >= 0:
            break
        here, time = at(arc, when), when
        if abs((here[1] - z) * dx - (here[0] - x) * dz) <= gap / 2 - c.radius:
            j += 1
    if j != int(f[k + PASSED]):
        f[k + PASSED] = j
        aim(f, k, hoops)
    if -lowest(arc, c.dt, 0.0, -1.0) > f[k + CEILING_Z] + CONTACT_SLACK:
        touched = CEILING
    if lowest(arc, c.dt, 0.0, 1.0) < f[k + FLOOR_Z] - CONTACT_SLACK:
        touched = FLOOR
    if c.radius > 0 and touches_rim(arc, c.dt, c.radius, hoops[:count]):
        touched = COLLISION
    return touched


@compiled
def touches_rim(arc: Any, h: float, radius: float, hoops: Any) -> bool:
    """Return whether a body touches an end of any gap."""
    for x, z, dx, dz, gap in hoops:
        for side in (-0.5, 0.5):
            if distance(arc, h, x - side * gap * dz, z + side * gap * dx) < radius:
                return True
    return False


@compiled
def aim(f: Any, k: Any, hoops: Any) -> None:
    """Fill in the next two hoops, and the length of the way from the first of them to the goal."""
    j, count = int(f[k + PASSED]), int(f[k + COUNT])
    for i in range(2):
        r = k + np.uint64(i) * (AHEAD2 - AHEAD1)
        f[r + AHEAD1] = 1.0 if j + i < count else 0.0
        if j + i < count:
            f[r + X1], f[r + Z1], f[r + DX1], f[r + DZ1], f[r + GAP1] = hoops[j + i]
        else:
            f[r + X1], f[r + Z1] = f[k + GOAL_X], f[k + GOAL_Z]
            f[r + DX1], f[r + DZ1], f[r + GAP1] = 0.0, 0.0, 0.0
    x, z, way = f[k + X1], f[k + Z1], 0.0
    for i in range(j + 1, count):
        way += math.hypot(hoops[i, 0] - x, hoops[i, 1] - z)
        x, z = hoops[i, 0], hoops[i, 1]
    f[k + WAY] = way + math.hypot(f[k + GOAL_X] - x, f[k + GOAL_Z] - z)


@vectors
def judge(f: Any, o: Any, n: Any, c: Any) -> None:
    """Count the step and say how the flight stands; FLAG holds the outcome of a contact, which comes first."""
    position, speed, angle, most = c.position, c.speed, c.angle, c.max_steps
    for i in range(n):
        k = o + i
        x, z, vx, vz, theta = f[k + X], f[k + Z], f[k + VX], f[k + VZ], f[k + THETA]
        gx, gz = x - f[k + GOAL_X], z - f[k + GOAL_Z]
        steps = f[k + STEPS] + 1
        tilt = theta - 2 * math.pi * np.floor(theta * (0.5 / math.pi) + 0.5)
        there = (gx * gx + gz * gz <= position * position) & (vx * vx + vz * vz <= speed * speed)
        there = there & (abs(tilt) <= angle) & (f[k + PASSED] >= f[k + COUNT])
        outside = (x < f[k + LOW_X]) | (x > f[k + HIGH_X]) | (z < f[k + LOW_Z]) | (z > f[k + HIGH_Z])
        code = float(TIME_LIMIT) if steps >= most else float(FLYING)
        code = float(GOAL) if there else code
        code = float(OUT_OF_BOUNDS) if outside else code
        code = f[k + FLAG] if f[k + FLAG] > 0 else code
        f[k + STEPS] = steps
        f[k + OUTCOME] = code


@vectors
def value(f: Any, o: Any, n: Any, c: Any) -> None:
    """Write the shaping potential of `flatgym.potential`, and keep the one before it."""
    thrust, gravity = c.thrust_max, c.gravity
    for i in range(n):
        f[o + FLAG + i] = 0.0
    for d in range(8):
        dx, dz = _DX[d], _DZ[d]
        forward, backward = thrust - gravity * dz, thrust + gravity * dz
        to_forward, to_backward, share = 1 / forward, 1 / backward, 1 / (forward + backward)
        for i in range(n):
            k = o + i
            offset = (f[k + GOAL_X] - f[k + X]) * dx + (f[k + GOAL_Z] - f[k + Z]) * dz
            speed = f[k + VX] * dx + f[k + VZ] * dz
            brake = speed * speed / 2 * (to_backward if speed > 0 else -to_forward)
            over = offset < brake
            offset, speed = (-offset if over else offset), (-speed if over else speed)
            ahead, back = (backward if over else forward), (forward if over else backward)
            to_ahead, to_back = (to_backward if over else to_forward), (to_forward if over else to_backward)
            peak = math.sqrt(max((2 * ahead * offset + speed * speed) * back * share, 0.0))
            f[k + FLAG] = max(f[k + FLAG], (peak - speed) * to_ahead + peak * to_back)
    for i in range(n):
        k = o + i
        x, z = f[k + X], f[k + Z]
        gx, gz, hx, hz = f[k + GOAL_X] - x, f[k + GOAL_Z] - z, f[k + X1] - x, f[k + Z1] - z
        detour = math.sqrt(hx * hx + hz * hz) + f[k + WAY] - math.sqrt(gx * gx + gz * gz)
        over = (f[k + OUTCOME] != FLYING) & (f[k + OUTCOME] != TIME_LIMIT)
        f[k + BEFORE] = f[k + POTENTIAL]
        f[k + POTENTIAL] = 0.0 if over else -f[k + FLAG] - detour / CRUISE_SPEED


@compiled
def start(f: Any, k: Any, c: Any, seed: Any, episode: Any, hoops: Any, numbers: Any, pool: Any, passed: Any) -> None:
    """Begin an episode: everything drawn, the vehicle at its start, its potential known."""
    if c.drawn:
        draw_scene(f, k, seed, episode, hoops, numbers)
    f[k + FACTOR], f[k + PULL_X], f[k + PULL_Z], f[k + DELAY] = 1.0, 0.0, -c.gravity, 0.0
    if c.disturbed:
        disturb(f, k, c, seed, episode)
    f[k + X], f[k + Z], f[k + VX], f[k + VZ], f[k + THETA] = f[k + START_X], f[k + START_Z], 0.0, 0.0, 0.0
    f[k + STEPS], f[k + PASSED], f[k + OUTCOME], f[k + WAITS] = 0.0, 0.0, FLYING, 0.0
    if pool.shape[0] > 0 and uniform(seed, episode, np.uint64(START)) < c.share:
        row = int(uniform(seed, episode, np.uint64(START + 1)) * pool.shape[0])
        f[k + X], f[k + Z], f[k + VX], f[k + VZ], f[k + THETA] = pool[row]
        f[k + PASSED] = passed[row]
    aim(f, k, hoops)
    value(f, k, ONE, c)


@compiled
def draw_scene(f: Any, k: Any, seed: Any, episode: Any, hoops: Any, numbers: Any) -> None:
    """Draw goal and hoops, and set the bounds around them, as `Scenario.bounds` does."""
    u, scene = np.empty(2 * TRIES + 1 + 3 * hoops.shape[0]), np.empty(PLACED + PER_HOOP * hoops.shape[0])
    for i in range(u.size):
        u[i] = uniform(seed, episode, np.uint64(SCENE + i))
    place(u, numbers, scene)
    f[k + GOAL_X], f[k + GOAL_Z], f[k + COUNT] = scene[0], scene[1], scene[2]
    low_x, high_x = min(0.0, scene[0]), max(0.0, scene[0])
    low_z, high_z = min(0.0, scene[1]), max(0.0, scene[1])
    for j in range(int(scene[2])):
        x, z, angle, gap = scene[PLACED + PER_HOOP * j : PLACED + PER_HOOP * (j + 1)]
        hoops[j] = x, z, math.cos(angle), math.sin(angle), gap
        low_x, high_x, low_z, high_z = min(low_x, x), max(high_x, x), min(low_z, z), max(high_z, z)
    f[k + LOW_X], f[k + HIGH_X] = low_x - BOUNDS_MARGIN, high_x + BOUNDS_MARGIN
    f[k + LOW_Z], f[k + HIGH_Z] = low_z - BOUNDS_MARGIN, high_z + BOUNDS_MARGIN


@compiled
def disturb(f: Any, k: Any, c: Any, seed: Any, episode: Any) -> None:
    """Draw the disturbances of an episode."""
    u, drawn = np.empty(5), np.empty(4)
    for i in range(5):
        u[i] = uniform(seed, episode, np.uint64(DISTURBANCE + i))
    affect(u, c.wind, c.thrust_gain, c.mass, c.action_delay, drawn)
    f[k + FACTOR], f[k + PULL_X], f[k + PULL_Z], f[k + DELAY] = drawn[0], drawn[1], drawn[2] - c.gravity, drawn[3]


@compiled
def measure(f: Any, o: Any, n: Any, c: Any, seeds: Any, episodes: Any, first: int) -> None:
    """Write the states as the sensors tell them."""
    for i in range(n):
        k, seed, episode = o + i, seeds[first + i], episodes[first + i]
        index = np.uint64(NOISE) + np.uint64(f[k + STEPS]) * np.uint64(10)
        for j in range(5):
            error = c.sensor_noise * normal(seed, episode, index + np.uint64(2 * j))
            f[k + MX + ROW[j]] = f[k + X + ROW[j]] + error


@vectors
def squash(length: float, unit: float) -> float:
    """Return length / (unit + |length|), 1 for what is very far."""
    length = min(length, FAR)
    return length / (unit + abs(length))


@vectors
def perceive_hoop(f: Any, o: Any, n: Any, m: Any, hoop: Any, to: Any) -> None:
    """Write what is seen of a hoop whose rows begin at `hoop` to the rows from OBSERVED + `to` on."""
    for i in range(n):
        k, s, w = o + hoop + i, o + m + i, o + OBSERVED + to + i
        f[w] = f[k + AHEAD1] * squash(f[k + X1] - f[s + X], LENGTH_UNIT)
        f[w + ROW[1]] = f[k + AHEAD1] * squash(f[k + Z1] - f[s + Z], LENGTH_UNIT)
        f[w + ROW[2]] = f[k + DX1]
        f[w + ROW[3]] = f[k + DZ1]
        f[w + ROW[4]] = squash(f[k + GAP1], LENGTH_UNIT)


@vectors
def perceive(f: Any, o: Any, n: Any, m: Any, max_steps: float) -> None:
    """Write the features of `flatgym.task.observe` to the rows from OBSERVED on; the state seen begins at row m."""
    for i in range(n):
        k, s, w = o + i, o + m + i, o + OBSERVED + i
        x, z = f[s + X], f[s + Z]
        f[w] = squash(f[k + GOAL_X] - x, LENGTH_UNIT)
        f[w + ROW[1]] = squash(f[k + GOAL_Z] - z, LENGTH_UNIT)
        f[w + ROW[2]] = squash(f[s + VX], SPEED_UNIT)
        f[w + ROW[3]] = squash(f[s + VZ], SPEED_UNIT)
        f[w + ROW[4]], f[w + ROW[5]] = sine_cosine(f[s + THETA])
    perceive_hoop(f, o, n, m, NONE, ROW[6])
    perceive_hoop(f, o, n, m, AHEAD2 - AHEAD1, ROW[11])
    for i in range(n):
        k, w = o + i, o + OBSERVED + i
        z = f[o + m + Z + i]
        f[w + ROW[16]] = squash(z - f[k + FLOOR_Z], LENGTH_UNIT)
        f[w + ROW[17]] = squash(f[k + CEILING_Z] - z, LENGTH_UNIT)
        f[w + ROW[18]] = min(f[k + STEPS] / max_steps, 1.0)


@compiled
def show(f: Any, o: Any, n: Any, c: Any, seeds: Any, episodes: Any, first: int, observation: Any) -> None:
    """Write the observations of a block."""
    seen = X
    if c.sensor_noise > 0:
        measure(f, o, n, c, seeds, episodes, first)
        seen = MX
    if c.features:
        perceive(f, o, n, seen, c.max_steps)
        seen = OBSERVED
    for i in range(n):
        for j in range(observation.shape[1]):
            observation[first + i, j] = f[o + seen + ROW[j] + i]


@compiled
def tell(f: Any, k: Any, i: Any, told: Any) -> None:
    """Write what `info` says of a vehicle."""
    state, steps, passed, outcome = told
    for j in range(5):
        state[i, j] = f[k + X + ROW[j]]
    steps[i], passed[i], outcome[i] = int(f[k + STEPS]), int(f[k + PASSED]), int(f[k + OUTCOME])


@cached
def reset(
    f: Any,
    seeds: Any,
    episodes: Any,
    hoops: Any,
    world: Any,
    mask: Any,
    given: Any,
    observation: Any,
    told: Any,
) -> None:
    """Begin an episode for all under `mask`; what is not nan of [x, z, vx, vz, theta, hoops passed] is `given`."""
    settings, numbers, pool, passed = world
    c = settings[0]
    for first in range(NONE, np.uint64(seeds.size), LANES):
        o, n = first // LANES * SPAN, min(LANES, np.uint64(seeds.size) - first)
        for i in range(n):
            k, lane = o + i, first + i
            if mask[lane]:
                start(f, k, c, seeds[lane], episodes[lane], hoops[lane], numbers, pool, passed)
                if given[lane, 0] == given[lane, 0]:
                    for j in range(5):
                        f[k + X + ROW[j]] = given[lane, j]
                if given[lane, 5] == given[lane, 5]:
                    f[k + PASSED] = given[lane, 5]
                aim(f, k, hoops[lane])
                value(f, k, ONE, c)
            tell(f, k, lane, told)
        show(f, o, n, c, seeds, episodes, first, observation)


@cached
def step(
    f: Any,
    seeds: Any,
    episodes: Any,
    hoops: Any,
    world: Any,
    pending: Any,
    actions: Any,
    observation: Any,
    reward: Any,
    terminated: Any,
    truncated: Any,
    told: Any,
    final_observation: Any,
    final: Any,
) -> int:
    """Fly all vehicles one step and begin anew what has ended; return how many have."""
    settings, numbers, pool, passed = world
    c = settings[0]
    ended = 0
    for first in range(NONE, np.uint64(seeds.size), LANES):
        o, n = first // LANES * SPAN, min(LANES, np.uint64(seeds.size) - first)
        command(f, o, n, c, actions, first)
        if c.action_delay > 0:
            delay(f, o, n, c, pending, first)
        fly(f, o, n, c.dt)
        suspect(f, o, n, c.dt, c.radius)
        for i in range(n):
            if c.radius > 0 or f[o + FLAG + i] > 0:
                f[o + FLAG + i] = meet(f, o + i, c, hoops[first + i])
        judge(f, o, n, c)
        value(f, o, n, c)
        over = 0
        for i in range(n):
            k, lane = o + i, first + i
            code = int(f[k + OUTCOME])
            terminated[lane] = code != FLYING and code != TIME_LIMIT
            truncated[lane] = code == TIME_LIMIT
            failed = terminated[lane] and code != GOAL
            reward[lane] = -c.dt - ((c.max_steps - f[k + STEPS]) * c.dt if failed else 0.0)
            if c.shaped:
                reward[lane] += f[k + POTENTIAL] - f[k + BEFORE]
            if f[k + WAITS] > 0:
                reward[lane], terminated[lane], truncated[lane] = 0.0, False, False
                episodes[lane] += ONE
                start(f, k, c, seeds[lane], episodes[lane], hoops[lane], numbers, pool, passed)
            elif code != FLYING:
                over += 1
                f[k + WAITS] = 1.0
        if over > 0 and c.same_step:
            show(f, o, n, c, seeds, episodes, first, final_observation)
            for i in range(n):
                if f[o + WAITS + i] > 0:
                    lane = first + i
                    tell(f, o + i, lane, final)
                    episodes[lane] += ONE
                    start(f, o + i, c, seeds[lane], episodes[lane], hoops[lane], numbers, pool, passed)
        ended += over
        show(f, o, n, c, seeds, episodes, first, observation)
        for i in range(n):
            tell(f, o + i, first + i, told)
    return ended
