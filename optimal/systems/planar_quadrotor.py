"""The paper's example: the planar quadrotor, flat with the output y = (x, z), eqs. (3)-(5).

    f = |(x'', z'' + g)|,   theta = atan2(x'', z'' + g),
    omega = (x''' (z'' + g) - x'' z''') / f^2.

Misprint corrected: the paper prints the numerator as x'' (z'' + g) - x'' z''.

In a program, tilt and thrust are lifted unknowns, coupled to the jet by x'' = f sin(theta) and z'' + g = f cos(theta).
The limits of the thrust are then simple bounds. The lift also keeps the feasible set connected. Admissible thrust
vectors form a ring, 1 <= f <= 20. Between two checks the vector could cross the hole of the ring, turning by half a
turn in no time. A constraint therefore limits the turn of the tilt between two checks to rate_max times the elapsed
time, which every flight satisfies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from flatgym.quadrotor import Array, Quadrotor
from optimal.systems.flat_system import FlatSystem, Jet, Lift, Symbol


@dataclass(frozen=True)
class PlanarQuadrotor(FlatSystem):
    """The planar quadrotor of `flatgym` as a flat system.

    Attributes:
        quadrotor: the vehicle and its limits.

    Raises:
        ValueError: without gravity, because at rest the thrust vector then vanishes, and the flat output determines no
            tilt; for a vehicle that cannot hover.
    """

    quadrotor: Quadrotor = field(default_factory=Quadrotor)

    outputs = ("x_m", "z_m")
    states = ("x_m", "z_m", "vx_mps", "vz_mps", "theta_rad")
    inputs = ("thrust_mps2", "rate_radps")
    order = 3
    angles = (4,)

    def __post_init__(self) -> None:
        if not self.quadrotor.gravity > 0:
            raise ValueError(
                "the flat method needs gravity > 0, because the thrust vector at rest determines the tilt there, got "
                f'Quadrotor.gravity = {self.quadrotor.gravity}; use `optimal.solve(..., method="shooting")`'
            )
        self.quadrotor.require_hover("Quadrotor")

    def dynamics(self, state: Symbol, control: Symbol) -> Symbol:
        """Return eqs. (3)-(5)."""
        thrust, tilt = control[0], state[4]
        acceleration = ca.vertcat(thrust * ca.sin(tilt), thrust * ca.cos(tilt) - self.quadrotor.gravity)
        return ca.vertcat(state[2], state[3], acceleration, control[1])

    def output(self, state: Symbol) -> Symbol:
        """Return the position."""
        return state[:2]

    def inverse(self, jet: Jet) -> tuple[Symbol, Symbol]:
        """Return state and input in closed form, eqs. (3)-(5)."""
        position, velocity, acceleration, jerk = jet
        side, up = acceleration[0], acceleration[1] + self.quadrotor.gravity
        square = side**2 + up**2
        rate = (jerk[0] * up - side * jerk[1]) / square
        return ca.vertcat(position, velocity, ca.atan2(side, up)), ca.vertcat(ca.sqrt(square), rate)

    def limited_values(self, jet: Sequence[ArrayLike]) -> Array:
        """Return thrust and rate divided by their limits, shape (..., 2): `inverse` on arrays, which is faster."""
        acceleration, jerk = (np.asarray(y, dtype=np.float64) for y in jet[2:])
        side, up = acceleration[..., 0], acceleration[..., 1] + self.quadrotor.gravity
        square = side**2 + up**2
        with np.errstate(divide="ignore", invalid="ignore"):  # without thrust there is no rate
            rate = (jerk[..., 0] * up - side * jerk[..., 1]) / square
        return np.stack([np.sqrt(square), rate], axis=-1) / self.bounds[1]

    def limits(self) -> tuple[Array, Array, Array, Array]:
        """Return the limits of thrust and rate; states are unlimited."""
        free = np.full(5, np.inf)
        return -free, free, self.quadrotor.control_low, self.quadrotor.control_high

    def lift(self) -> Lift:
        """Return tilt and thrust as lifted unknowns."""
        return TiltAndThrust(self)


class TiltAndThrust(Lift):
    """Tilt and thrust as lifted unknowns of a program."""

    names = ("tilt", "thrust")
    limited = (1,)

    def __init__(self, system: PlanarQuadrotor) -> None:
        super().__init__(system)
        self.quadrotor = q = system.quadrotor
        self.low, self.high = (-np.inf, q.thrust_min), (np.inf, q.thrust_max)
        self.rest, self.guess = (0.0, np.nan), (0.0, q.gravity)

    def coupling(self, jet: Jet, lifted: Symbol) -> Symbol:
        """Return the residuals of eqs. (3) and (4), divided by g."""
        tilt, thrust, q = lifted[0], lifted[1], self.quadrotor
        missing = jet[2] - thrust * ca.vertcat(ca.sin(tilt), ca.cos(tilt)) + ca.DM([0.0, q.gravity])
        return missing / q.gravity

    def limited_quantities(self, jet: Jet, lifted: Symbol) -> Symbol:
        """Return the rate divided by its limit. It is the jerk across the thrust over the thrust."""
        tilt, thrust, q = lifted[0], lifted[1], self.quadrotor
        return (jet[3][0] * ca.cos(tilt) - jet[3][1] * ca.sin(tilt)) / thrust / q.rate_max

    def values(self, jet: Sequence[Array]) -> Array:
        """Return tilt and thrust along a motion; the tilt does not jump."""
        side, up = jet[2][:, 0], jet[2][:, 1] + self.quadrotor.gravity
        return np.stack([np.unwrap(np.arctan2(side, up)), np.hypot(side, up)], axis=-1)

    def turning_time(self, before: Symbol, after: Symbol) -> Symbol:
        """Return the least time of the turn of the tilt, with the sign of the turn."""
        return (after[0] - before[0]) / self.quadrotor.rate_max
