"""What a step is worth: the shaping potential of `flatgym.potential`, and the reward of `flatgym.task`."""

from __future__ import annotations

import math
from typing import Any

from flatgym.kernels.layout import (
    BEFORE,
    END,
    FLAG,
    GOAL_X,
    GOAL_Z,
    LANES,
    OUTCOME,
    POTENTIAL,
    REWARD,
    STEPS,
    VX,
    VZ,
    WAITS,
    WAY,
    X1,
    Z1,
    X,
    Z,
    vectors,
)
from flatgym.potential import CRUISE_SPEED, DIRECTIONS
from flatgym.scene import FLYING, GOAL, TIME_LIMIT

_DX, _DZ = tuple(map(float, DIRECTIONS[0])), tuple(map(float, DIRECTIONS[1]))


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


@vectors
def pay(f: Any, o: Any, c: Any) -> None:
    """Write reward and end of the step; who begins anew in this step has neither."""
    dt, most, shaped = c.dt, c.max_steps, (1.0 if c.shaped else 0.0)
    for i in range(LANES):
        k = o + i
        code, waits = f[k + OUTCOME], f[k + WAITS]
        failed = (code != FLYING) & (code != TIME_LIMIT) & (code != GOAL)
        reward = -dt - ((most - f[k + STEPS]) * dt if failed else 0.0) + shaped * (f[k + POTENTIAL] - f[k + BEFORE])
        f[k + REWARD] = 0.0 if waits > 0 else reward
        f[k + END] = 0.0 if waits > 0 else code
