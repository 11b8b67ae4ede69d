"""Reward of a step: `flatgym.task.shaping.potential` and `flatgym.task.reward`."""

from __future__ import annotations

import math
from typing import Any

from flatgym.kernels.layout import (
    AWAY_X,
    AWAY_Z,
    BEFORE,
    END,
    FLAG,
    GOAL_X,
    GOAL_Z,
    OUTCOME,
    POTENTIAL,
    REWARD,
    STEPS,
    VX,
    VZ,
    WAITED,
    WAY,
    X1,
    Z1,
    X,
    Z,
    vectorized,
)
from flatgym.task.scene import FLYING, GOAL, TIME_LIMIT
from flatgym.task.shaping import CRUISE_SPEED, DIRECTIONS

_DX, _DZ = tuple(map(float, DIRECTIONS[0])), tuple(map(float, DIRECTIONS[1]))


@vectorized
def write_potential(f: Any, s: Any, o: Any, n: Any, c: Any) -> None:
    """Write the shaping potential of a block, and copy the previous one to BEFORE."""
    thrust, gravity = c.thrust_max, c.gravity
    for i in range(n):
        s[FLAG + i] = 0.0
        s[AWAY_X + i], s[AWAY_Z + i] = f[o + GOAL_X + i] - f[o + X + i], f[o + GOAL_Z + i] - f[o + Z + i]
    for d in range(len(_DX)):
        dx, dz = _DX[d], _DZ[d]
        forward, backward = thrust - gravity * dz, thrust + gravity * dz
        to_forward, to_backward = 1 / forward, 1 / backward
        both = to_forward + to_backward
        for i in range(n):
            k = o + i
            offset = s[AWAY_X + i] * dx + s[AWAY_Z + i] * dz
            speed = f[k + VX] * dx + f[k + VZ] * dz
            over = 2 * offset < speed * abs(speed) * (to_backward if speed > 0 else to_forward)
            offset, speed = (-offset if over else offset), (-speed if over else speed)
            begun = speed * (to_backward if over else to_forward)
            s[i + FLAG] = max(s[i + FLAG], math.sqrt(both * max(2 * offset + speed * begun, 0.0)) - begun)
    for i in range(n):
        k = o + i
        x, z = f[k + X], f[k + Z]
        gx, gz, hx, hz = s[AWAY_X + i], s[AWAY_Z + i], f[k + X1] - x, f[k + Z1] - z
        detour = math.sqrt(hx * hx + hz * hz) + f[k + WAY] - math.sqrt(gx * gx + gz * gz)
        over = (f[k + OUTCOME] != FLYING) & (f[k + OUTCOME] != TIME_LIMIT)
        s[i + BEFORE] = f[k + POTENTIAL]
        f[k + POTENTIAL] = 0.0 if over else -s[i + FLAG] - detour / CRUISE_SPEED


@vectorized
def write_reward(f: Any, s: Any, o: Any, m: Any, c: Any) -> None:
    """Write REWARD and END of a step; both are 0 for a vehicle that this step resets."""
    dt, most, shaped = c.dt, c.max_steps, (1.0 if c.shaped else 0.0)
    for i in range(m):
        k = o + i
        code, waits = f[k + OUTCOME], s[i + WAITED]
        failed = (code != FLYING) & (code != TIME_LIMIT) & (code != GOAL)
        reward = -dt - ((most - f[k + STEPS]) * dt if failed else 0.0) + shaped * (f[k + POTENTIAL] - s[i + BEFORE])
        s[i + REWARD] = 0.0 if waits > 0 else reward
        s[i + END] = 0.0 if waits > 0 else code
