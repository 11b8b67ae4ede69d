"""An overhead crane: a trolley on a rail, a hoist, and a load on a taut rope.

The trolley is at (X, 0). The load hangs at x = X + L sin(sway), z = -L cos(sway). The tension acts along the rope, so
x'' / (z'' + g) = -tan(sway), and the position of the load is a flat output:

    tan(sway) = -x'' / (z'' + g),    X = x + z tan(sway),    L = -z / cos(sway).

The inputs are the accelerations X'' of the trolley and L'' of the hoist, of fourth order in y = (x, z). CasADi computes
the further derivatives. (Fliess, Levine, Martin and Rouchon 1995 treat this crane.)
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from optimal.systems.flat_system import FlatSystem, Jet, Symbol, time_derivative


@dataclass(frozen=True)
class OverheadCrane(FlatSystem):
    """A crane with the accelerations of trolley and hoist as inputs.

    Attributes:
        trolley_max, hoist_max: limits of the accelerations [m/s^2].
        sway_max: limit of the rope's angle from the vertical [rad].
        rope_min: least rope length [m].
        gravity: gravitational acceleration [m/s^2].

    Raises:
        ValueError: for a value that is not positive.
    """

    trolley_max: float = 2.0
    hoist_max: float = 2.0
    sway_max: float = 0.3
    rope_min: float = 0.5
    gravity: float = 9.81

    outputs = ("x_m", "z_m")
    states = ("trolley_m", "rope_m", "sway_rad", "trolley_mps", "rope_mps", "sway_radps")
    inputs = ("trolley_mps2", "rope_mps2")
    order = 4

    def __post_init__(self) -> None:
        for name in ("trolley_max", "hoist_max", "sway_max", "rope_min", "gravity"):
            if not getattr(self, name) > 0:
                raise ValueError(f"OverheadCrane.{name} must be positive, got {getattr(self, name)!r}")

    def dynamics(self, state: Symbol, control: Symbol) -> Symbol:
        """Return the dynamics of a pendulum of varying length: L sway'' = -X'' cos(sway) - 2 L' sway' - g sin(sway)."""
        rope, sway = state[1], state[2]
        rope_speed, sway_speed = state[4], state[5]
        pull = control[0] * ca.cos(sway) + 2 * rope_speed * sway_speed + self.gravity * ca.sin(sway)
        return ca.vertcat(state[3:], control, -pull / rope)

    def output(self, state: Symbol) -> Symbol:
        """Return the position of the load."""
        return ca.vertcat(state[0] + state[1] * ca.sin(state[2]), -state[1] * ca.cos(state[2]))

    def inverse(self, jet: Jet) -> tuple[Symbol, Symbol]:
        """Return state and input: trolley, rope and sway in closed form, the others by time derivatives."""
        (x, z), up = ca.vertsplit(jet[0]), jet[2][1] + self.gravity
        slope = 0 - jet[2][0] / up
        position = ca.vertcat(x + z * slope, 0 - z * ca.sqrt(1 + slope**2), ca.atan(slope))
        speed = time_derivative(position, jet)
        return ca.vertcat(position, speed), time_derivative(speed, jet)[:2]

    def limits(self) -> tuple[Array, Array, Array, Array]:
        """Return the limits of rope, sway and both accelerations."""
        low, high = np.full(6, -np.inf), np.full(6, np.inf)
        low[1], low[2], high[2] = self.rope_min, -self.sway_max, self.sway_max
        control = np.array([self.trolley_max, self.hoist_max], dtype=np.float64)
        return low, high, -control, control
