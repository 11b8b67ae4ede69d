"""The full quadrotor, flat with the outputs y = (x, y, z, yaw) (section II-A, last example).

With R = Rz(yaw) Ry(pitch) Rx(roll) from body to world and n = R e_z the direction of the thrust,

    p'' = f n - g e_z,    R' = R [p, q, r]x.

The acceleration gives f and n. Pitch and roll follow from n rotated back by the yaw,

    Rz(-yaw) n = (sin(pitch) cos(roll), -sin(roll), cos(pitch) cos(roll)),

and the body rates from the time derivative R'. The pitch is unrestricted. |roll| must be below a quarter turn, because
the yaw of R is undetermined beyond. Where the yaw is read from R, the vehicle is assumed to be upright. (Mellinger and
Kumar 2011.)

In a program, yaw, pitch, roll and thrust are lifted unknowns; see `optimal.systems.planar_quadrotor`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from optimal.systems.flat_system import FlatSystem, Jet, Lift, Symbol, time_derivative

CHORD_SMOOTHING = 1e-6
"""Added to the squared length of a turn to keep it differentiable at zero (a chord of 1e-3 rad)."""


@dataclass(frozen=True)
class FullQuadrotor(FlatSystem):
    """A quadrotor in space with thrust and body rates as inputs.

    The state is position, velocity and the nine entries of R, column by column.

    Attributes:
        thrust_min, thrust_max: limits of the mass-normalised thrust [m/s^2].
        rate_max: limit of each body rate, in either direction [rad/s].
        gravity: gravitational acceleration [m/s^2].

    Raises:
        ValueError: for limits under which the vehicle cannot hover or turn.
    """

    thrust_min: float = 1.0
    thrust_max: float = 20.0
    rate_max: float = 10.0
    gravity: float = 9.81

    outputs = ("x_m", "y_m", "z_m", "yaw_rad")
    states = (
        *("x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps"),
        *(f"r{row}{column}" for column in "xyz" for row in "xyz"),
    )
    inputs = ("thrust_mps2", "roll_rate_radps", "pitch_rate_radps", "yaw_rate_radps")
    order = 3

    def __post_init__(self) -> None:
        if not 0 <= self.thrust_min <= self.gravity < self.thrust_max < np.inf:
            raise ValueError(
                "FullQuadrotor cannot hover: needs 0 <= thrust_min <= gravity < thrust_max < inf, got "
                f"{self.thrust_min}, {self.gravity}, {self.thrust_max}"
            )
        if not self.gravity > 0:
            raise ValueError(
                "FullQuadrotor.gravity must be positive, because the thrust vector at rest determines the attitude "
                f"there, got {self.gravity!r}"
            )
        if not 0 < self.rate_max < np.inf:
            raise ValueError(f"FullQuadrotor.rate_max must be positive and finite, got {self.rate_max!r}")

    def dynamics(self, state: Symbol, control: Symbol) -> Symbol:
        """Return velocity, thrust and gravity, and R [rates]x."""
        attitude = ca.reshape(state[6:], 3, 3)
        acceleration = control[0] * attitude[:, 2] - ca.DM([0, 0, self.gravity])
        return ca.vertcat(state[3:6], acceleration, ca.vec(attitude @ ca.skew(control[1:])))

    def output(self, state: Symbol) -> Symbol:
        """Return position and yaw. The vehicle is assumed to be upright."""
        return ca.vertcat(state[:3], ca.atan2(state[7], state[6]))

    def inverse(self, jet: Jet) -> tuple[Symbol, Symbol]:
        """Return state and input: thrust and attitude in closed form, body rates by a time derivative."""
        force = jet[2][:3] + ca.DM([0, 0, self.gravity])
        thrust, yaw = ca.norm_2(force), jet[0][3]
        direction = _about_z(-yaw) @ force / thrust
        cos_roll = ca.sqrt(direction[0] ** 2 + direction[2] ** 2)
        attitude = _attitude(yaw, direction[0] / cos_roll, direction[2] / cos_roll, -direction[1], cos_roll)
        turning = ca.reshape(time_derivative(ca.vec(attitude), jet), 3, 3)
        rates = ca.inv_skew(attitude.T @ turning)
        return ca.vertcat(jet[0][:3], jet[1][:3], ca.vec(attitude)), ca.vertcat(thrust, rates)

    def limits(self) -> tuple[Array, Array, Array, Array]:
        """Return the limits of thrust and body rates; states are unlimited."""
        free, rates = np.full(15, np.inf), np.full(3, float(self.rate_max))
        return -free, free, np.append(self.thrust_min, -rates), np.append(self.thrust_max, rates)

    def lift(self) -> Lift:
        """Return attitude and thrust as lifted unknowns."""
        return Attitude(self)


class Attitude(Lift):
    """Yaw, pitch, roll and thrust as lifted unknowns of a program."""

    names = ("yaw", "pitch", "roll", "thrust")
    limited = (3,)

    def __init__(self, system: FullQuadrotor) -> None:
        super().__init__(system)
        self.quadrotor = system
        self.low = (-np.inf, -np.inf, -1.5, system.thrust_min)
        self.high = (np.inf, np.inf, 1.5, system.thrust_max)
        self.rest, self.guess = (np.nan, 0.0, 0.0, np.nan), (0.0, 0.0, 0.0, system.gravity)

    def coupling(self, jet: Jet, lifted: Symbol) -> Symbol:
        """Return the difference of the yaws, and p'' + g e_z - f n divided by g."""
        force = jet[2][:3] + ca.DM([0, 0, self.quadrotor.gravity])
        missing = force - lifted[3] * self._attitude(lifted)[:, 2]
        return ca.vertcat(jet[0][3] - lifted[0], missing / self.quadrotor.gravity)

    def limited_quantities(self, jet: Jet, lifted: Symbol) -> Symbol:
        """Return the body rates divided by their limit, from the jerk f' n + f (q x_body - p y_body)."""
        pitch, roll, thrust = lifted[1], lifted[2], lifted[3]
        across = self._attitude(lifted).T @ jet[3][:3] / thrust
        yaw_rate = (jet[1][3] * ca.cos(pitch) - across[0] * ca.sin(roll)) / ca.cos(roll)
        return ca.vertcat(-across[1], across[0], yaw_rate) / self.quadrotor.rate_max

    def values(self, jet: Sequence[Array]) -> Array:
        """Return yaw, pitch, roll and thrust along a motion."""
        force = jet[2][:, :3] + np.array([0.0, 0.0, self.quadrotor.gravity])
        thrust, yaw = np.linalg.norm(force, axis=1), jet[0][:, 3]
        ahead = (np.cos(yaw) * force[:, 0] + np.sin(yaw) * force[:, 1]) / thrust
        left = (np.cos(yaw) * force[:, 1] - np.sin(yaw) * force[:, 0]) / thrust
        pitch = np.unwrap(np.arctan2(ahead, force[:, 2] / thrust))
        return np.stack([yaw, pitch, -np.arcsin(np.clip(left, -1, 1)), thrust], axis=-1)

    def turning_time(self, before: Symbol, after: Symbol) -> Symbol:
        """Return the least time in which two body rates turn the thrust direction by the chord."""
        chord = self._attitude(after)[:, 2] - self._attitude(before)[:, 2]
        return ca.sqrt(ca.sumsqr(chord) + CHORD_SMOOTHING) / (np.sqrt(2) * self.quadrotor.rate_max)

    @staticmethod
    def _attitude(lifted: Symbol) -> Symbol:
        yaw, pitch, roll = lifted[0], lifted[1], lifted[2]
        return _attitude(yaw, ca.sin(pitch), ca.cos(pitch), ca.sin(roll), ca.cos(roll))


def _about_z(angle: Symbol) -> Symbol:
    """Return the rotation matrix about the z axis."""
    sin, cos = ca.sin(angle), ca.cos(angle)
    return ca.vertcat(ca.horzcat(cos, -sin, 0), ca.horzcat(sin, cos, 0), ca.horzcat(0, 0, 1))


def _attitude(yaw: Symbol, sin_pitch: Symbol, cos_pitch: Symbol, sin_roll: Symbol, cos_roll: Symbol) -> Symbol:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll)."""
    about_y = ca.vertcat(ca.horzcat(cos_pitch, 0, sin_pitch), ca.horzcat(0, 1, 0), ca.horzcat(-sin_pitch, 0, cos_pitch))
    about_x = ca.vertcat(ca.horzcat(1, 0, 0), ca.horzcat(0, cos_roll, -sin_roll), ca.horzcat(0, sin_roll, cos_roll))
    return _about_z(yaw) @ about_y @ about_x
