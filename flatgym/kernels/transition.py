"""One step of a block: controls, exact step, contacts within it, and outcome."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flatgym.kernels.arithmetic import bessel, sine_cosine
from flatgym.kernels.events import at, crossing, distance, lowest
from flatgym.kernels.layout import (
    AHEAD1,
    BTHETA,
    BVX,
    BVZ,
    BX,
    BZ,
    COUNT,
    DELAY,
    DX1,
    DZ1,
    FACTOR,
    FLAG,
    GAP1,
    GOAL_X,
    GOAL_Z,
    HIGH_X,
    HIGH_Z,
    LOW_X,
    LOW_Z,
    OUTCOME,
    PASSED,
    PULL_X,
    PULL_Z,
    RATE,
    STEPS,
    THETA,
    THRUST,
    VX,
    VZ,
    WAITED,
    X1,
    Z1,
    X,
    Z,
    compiled,
    vectorized,
)
from flatgym.kernels.reset import find_next_hoops
from flatgym.task.scene import CEILING, COLLISION, FLOOR, FLYING, GOAL, OUT_OF_BOUNDS, TIME_LIMIT
from flatgym.task.transition import CONTACT_SLACK


@vectorized
def scale_actions(s: Any, m: Any, c: Any, actions: Any, first: int) -> None:
    """Clip actions to the box and scale them to thrust and rate."""
    low, high, most = c.thrust_min, c.thrust_max, c.rate_max
    for i in range(m):
        push, turn = actions[first + i, 0], actions[first + i, 1]
        push = (min(max(push, -1.0), 1.0) + 1) / 2
        turn = (min(max(turn, -1.0), 1.0) + 1) / 2
        s[THRUST + i] = low * (1 - push) + high * push
        s[RATE + i] = -most * (1 - turn) + most * turn


@compiled
def delay_controls(f: Any, s: Any, o: Any, n: Any, c: Any, pending: Any, first: int) -> None:
    """Queue the controls and replace them by those that act in this step; hover before the first one acts."""
    slots = pending.shape[1]
    for i in range(n):
        lane, step, late = first + i, int(f[o + STEPS + i]), int(f[o + DELAY + i])
        pending[lane, step % slots, 0] = s[THRUST + i]
        pending[lane, step % slots, 1] = s[RATE + i]
        if late > step:
            s[THRUST + i], s[RATE + i] = c.gravity, 0.0
        else:
            s[THRUST + i] = pending[lane, (step - late) % slots, 0]
            s[RATE + i] = pending[lane, (step - late) % slots, 1]


@vectorized
def exact_step(f: Any, s: Any, o: Any, m: Any, h: float) -> None:
    """Compute the exact step of `flatgym.quadrotor`; a scenario's dt guarantees |rate| h / 2 <= pi."""
    for i in range(m):
        k = o + i
        x, z, vx, vz, theta = f[k + X], f[k + Z], f[k + VX], f[k + VZ], f[k + THETA]
        pull_x, pull_z, rate = f[k + PULL_X], f[k + PULL_Z], s[i + RATE]
        a, dv = rate * h / 2, s[i + THRUST] * f[k + FACTOR] * h
        j0, j1 = bessel(a)
        sine, cosine = sine_cosine(theta + a)
        s[i + BX], s[i + BZ], s[i + BVX], s[i + BVZ], s[i + BTHETA] = x, z, vx, vz, theta
        f[k + X] = x + (vx + pull_x * h / 2) * h + dv * h / 2 * (j0 * sine - j1 * cosine)
        f[k + Z] = z + (vz + pull_z * h / 2) * h + dv * h / 2 * (j0 * cosine + j1 * sine)
        f[k + VX] = vx + dv * j0 * sine + pull_x * h
        f[k + VZ] = vz + dv * j0 * cosine + pull_z * h
        f[k + THETA] = theta + rate * h


@vectorized
def flag_contacts(f: Any, s: Any, o: Any, m: Any, c: Any) -> int:
    """Flag the vehicles that may have crossed a gap or touched floor or ceiling within the step; return how many.

    The distance of an arc to its chord is at most |p''| h^2 / 8, and |p''| is at most thrust plus pull.
    """
    h, radius, floor, ceiling, marked = c.dt, c.radius, c.floor, c.ceiling, 0
    for i in range(m):
        k = o + i
        bow = s[i + THRUST] * f[k + FACTOR] + abs(f[k + PULL_X]) + abs(f[k + PULL_Z])
        bow = bow * h * h / 8
        dx, dz, x, z = f[k + DX1], f[k + DZ1], f[k + X] - f[k + X1], f[k + Z] - f[k + Z1]
        bx, bz = s[i + BX] - f[k + X1], s[i + BZ] - f[k + Z1]
        along, before = x * dx + z * dz, bx * dx + bz * dz
        aside, aside_before = z * dx - x * dz, bz * dx - bx * dz
        crosses = (min(along, before) - bow < 0) & (max(along, before) + bow >= 0)
        gap = f[k + GAP1] / 2 - radius + bow
        inside = (min(aside, aside_before) <= gap) & (max(aside, aside_before) >= -gap)
        # If the bound of |p'''| shows that vz keeps its sign, the extreme heights are those at the ends.
        bend = s[i + THRUST] * f[k + FACTOR] * abs(s[i + RATE]) * h * h / 8
        steady = (min(f[k + VZ], s[i + BVZ]) >= bend) | (max(f[k + VZ], s[i + BVZ]) <= -bend)
        stray = 0.0 if steady else bow
        low = min(f[k + Z], s[i + BZ]) - stray < floor
        high = max(f[k + Z], s[i + BZ]) + stray > ceiling
        met = ((f[k + AHEAD1] > 0) & crosses & inside) | low | high
        s[i + FLAG] = 1.0 if met else 0.0
        marked += 1 if met else 0
    return marked


@compiled
def arc_of(f: Any, s: Any, k: Any, i: Any) -> Any:
    """Return the arc of the step just computed, as a tuple for `flatgym.kernels.events`."""
    thrust = s[i + THRUST] * f[k + FACTOR]
    state = (s[i + BX], s[i + BZ], s[i + BVX], s[i + BVZ], s[i + BTHETA])
    return (*state, thrust, s[i + RATE], f[k + PULL_X], f[k + PULL_Z])


@compiled
def resolve_contacts(f: Any, s: Any, k: Any, i: Any, c: Any, hoops: Any) -> int:
    """Count the hoops passed within the step; return the outcome of a contact with rim, floor or ceiling, or FLYING."""
    arc, touched, time = arc_of(f, s, k, i), FLYING, 0.0
    j, count = int(f[k + PASSED]), int(f[k + COUNT])
    while j < count:
        x, z, dx, dz, gap = hoops[j, 0], hoops[j, 1], hoops[j, 2], hoops[j, 3], hoops[j, 4]
        end = (f[k + X] - x) * dx + (f[k + Z] - z) * dz
        when = crossing(arc, c.dt, x, z, dx, dz, time, end)
        if not when >= 0:
            break
        here, time = at(arc, when), when
        if abs((here[1] - z) * dx - (here[0] - x) * dz) <= gap / 2 - c.radius:
            j += 1
        if time >= c.dt:
            break
    if j != int(f[k + PASSED]):
        f[k + PASSED] = j
        find_next_hoops(f, k, hoops)
    # A bound of the height difference within the step; it rules out at least one of the two in most cases.
    reach = (abs(s[i + BVZ]) + (arc[5] + abs(arc[8])) * c.dt) * c.dt
    for up, limit, contact in ((-1.0, -c.ceiling, CEILING), (1.0, c.floor, FLOOR)):
        near, limit = up * s[i + BZ] - reach < limit, limit - CONTACT_SLACK
        if up * f[k + Z] < limit or (near and lowest(arc, c.dt, 0.0, up) < limit):
            touched = contact
    if c.radius > 0 and touches_rim(arc, c.dt, c.radius, hoops, count):
        touched = COLLISION
    return touched


@compiled
def check_contacts(f: Any, s: Any, o: Any, n: Any, m: Any, c: Any, hoops: Any, first: int) -> None:
    """Resolve the contacts of the flagged vehicles, and of all if they have a radius; write outcomes to FLAG."""
    if flag_contacts(f, s, o, m, c) == 0 and c.radius == 0:
        return
    for i in range(n):
        if c.radius > 0 or s[FLAG + i] > 0:
            s[FLAG + i] = resolve_contacts(f, s, o + i, i, c, hoops[first + i])


@compiled
def touches_rim(arc: Any, h: float, radius: float, hoops: Any, count: int) -> bool:
    """Return whether a body of this radius [m] touches an end of any gap within the step."""
    for j in range(count):
        x, z, dx, dz, gap = hoops[j, 0], hoops[j, 1], hoops[j, 2], hoops[j, 3], hoops[j, 4]
        for i in range(2):
            side = (i - 0.5) * gap
            if distance(arc, h, x - side * dz, z + side * dx, radius) < radius:
                return True
    return False


@vectorized
def write_outcome(f: Any, s: Any, o: Any, m: Any, c: Any) -> None:
    """Count the step and write the outcome; that of a contact, in FLAG, takes precedence."""
    position, speed, angle, most = c.position, c.speed, c.angle, c.last_step
    for i in range(m):
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
        code = s[i + FLAG] if s[i + FLAG] > 0 else code
        f[k + STEPS] = steps
        s[i + WAITED] = f[k + OUTCOME]
        f[k + OUTCOME] = code
