"""The replay: exact for held controls, of fourth order for smooth ones, and within the limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flatgym import Quadrotor
from flatgym.quadrotor import Array
from optimal.flights.replay import ORDER, replay_controls
from optimal.flights.trajectory import Trajectory

QUADROTOR = Quadrotor()


class Flight:
    """A flight with given controls of time, integrated numerically from rest."""

    def __init__(self, control, duration: float = 1.0) -> None:
        self.control, self.duration, self.breakpoints = control, duration, np.array([0.0, duration])

        def derivative(t: float, x: Array) -> Array:
            thrust, rate = control(np.array(t))
            return np.array([x[2], x[3], thrust * np.sin(x[4]), thrust * np.cos(x[4]) - QUADROTOR.gravity, rate])

        self._motion = solve_ivp(derivative, (0, duration), np.zeros(5), rtol=1e-12, atol=1e-13, dense_output=True).sol

    def state(self, t: Array) -> Array:
        return np.moveaxis(self._motion(np.atleast_1d(t)), 0, -1)


def smooth(t: Array) -> Array:
    return np.stack([10 + 4 * np.sin(5 * t), 6 * np.cos(3 * t) + 2 * t], axis=-1)


def error(flight: Flight, parts: int) -> float:
    time = np.linspace(0.0, flight.duration, parts + 1)
    replay, _ = replay_controls(flight, QUADROTOR, np.zeros(5), time, flight.state(time))
    return float(np.abs(replay - flight.state(time)).max())


def test_the_error_of_smooth_controls_falls_with_the_fourth_order():
    flight = Flight(smooth)
    errors = [error(flight, parts) for parts in (8, 16, 32)]
    orders = -np.diff(np.log2(errors))
    assert orders == pytest.approx(ORDER, abs=0.2)


def test_held_controls_are_replayed_exactly(generator):
    controls = generator.uniform(QUADROTOR.control_low, QUADROTOR.control_high, size=(20, 2))
    states = QUADROTOR.fly(np.zeros(5), controls, 0.03)
    flight = Trajectory(0.03 * np.arange(21), states, controls, QUADROTOR)
    replay, arcs = replay_controls(flight, QUADROTOR, np.zeros(5), flight.breakpoints, flight.states)
    np.testing.assert_allclose(replay, flight.states, atol=1e-12)
    np.testing.assert_allclose(arcs.control[::2], controls, atol=1e-12)
    np.testing.assert_allclose(arcs.control[1::2], controls, atol=1e-12)


def test_the_arcs_keep_limits_that_the_flight_keeps_even_where_controls_jump():
    low, high = QUADROTOR.control_low, QUADROTOR.control_high

    def jumping(t: Array) -> Array:
        return np.where(np.asarray(t)[..., None] < 0.37, high, low)

    time = np.linspace(0.0, 1.0, 11)
    tilt = np.where(time < 0.37, high[1] * time, high[1] * 0.37 + low[1] * (time - 0.37))
    states = np.zeros((11, 5))
    states[:, 4] = tilt

    class Jump:
        control = staticmethod(jumping)

    replay, arcs = replay_controls(Jump(), QUADROTOR, np.zeros(5), time, states)
    slack = 1e-12 * high
    assert np.all((arcs.control >= low - slack) & (arcs.control <= high + slack))
    np.testing.assert_allclose(replay[:, 4], tilt, atol=1e-12)
