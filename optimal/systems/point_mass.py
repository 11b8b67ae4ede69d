"""A point mass with an acceleration along each axis: y'' = u, with limits of velocities and accelerations.

This is the simplest flat system: state and input are the jet itself. It models a gantry robot or the axes of a machine
tool. All limits are of second order, and path following has known solutions.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from optimal.systems.flat_system import FlatSystem, Jet, Symbol


@dataclass(frozen=True)
class PointMass(FlatSystem):
    """A point mass in the plane.

    Attributes:
        speed_max: limit of the speed along either axis [m/s].
        acceleration_max: limit of the acceleration along either axis [m/s^2].

    Raises:
        ValueError: for a limit that is not positive.
    """

    speed_max: float = np.inf
    acceleration_max: float = 10.0

    outputs = ("x_m", "z_m")
    states = ("x_m", "z_m", "vx_mps", "vz_mps")
    inputs = ("ax_mps2", "az_mps2")
    order = 2

    def __post_init__(self) -> None:
        for name in ("speed_max", "acceleration_max"):
            if not getattr(self, name) > 0:
                raise ValueError(f"PointMass.{name} must be positive, got {getattr(self, name)!r}")

    def dynamics(self, state: Symbol, control: Symbol) -> Symbol:
        """Return velocity and acceleration."""
        return ca.vertcat(state[2:], control)

    def output(self, state: Symbol) -> Symbol:
        """Return the position."""
        return state[:2]

    def inverse(self, jet: Jet) -> tuple[Symbol, Symbol]:
        """Return the jet."""
        return ca.vertcat(jet[0], jet[1]), jet[2]

    def limits(self) -> tuple[Array, Array, Array, Array]:
        """Return the limits of velocity and acceleration; the position is unlimited."""
        state = np.array([np.inf, np.inf, self.speed_max, self.speed_max])
        control = np.full(2, float(self.acceleration_max))
        return -state, state, -control, control
