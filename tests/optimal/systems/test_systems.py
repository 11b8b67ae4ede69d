"""Flat systems: states to jets and back, the planar inside the full quadrotor, and lifts that agree with `inverse`."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from flatgym.quadrotor import Array, Quadrotor
from optimal.systems import (
    FlatSystem,
    FullQuadrotor,
    OverheadCrane,
    PlanarQuadrotor,
    PointMass,
    along_path,
    time_derivative,
)

STEEP = np.deg2rad(80)
SYSTEMS = [PlanarQuadrotor(), FullQuadrotor(), PointMass(speed_max=3.0), OverheadCrane()]
IDS = [type(system).__name__ for system in SYSTEMS]


def random_motion(system: FlatSystem, generator: np.random.Generator) -> tuple[Array, Array]:
    """Return a state and an input within the limits."""
    _, _, low, high = system.limits()
    control, place = generator.uniform(low, high), generator.normal(size=6)
    if isinstance(system, PlanarQuadrotor):
        return np.append(place[:4], generator.uniform(-3, 3)), control
    if isinstance(system, FullQuadrotor):
        turns = generator.uniform([-3, -STEEP, -STEEP], [3, STEEP, STEEP])
        attitude = Rotation.from_euler("ZYX", turns).as_matrix()
        return np.concatenate([place, attitude.ravel(order="F")]), control
    if isinstance(system, OverheadCrane):
        return np.array([place[0], generator.uniform(0.5, 5), *0.3 * place[2:]]), control
    return place[:4], control


def lifted_unknowns(system: FlatSystem, state: Array, control: Array) -> Array:
    """Return the lifted unknowns of a state."""
    if isinstance(system, PlanarQuadrotor):
        return np.array([state[4], control[0]])
    if isinstance(system, FullQuadrotor):
        angles = Rotation.from_matrix(state[6:].reshape(3, 3).T).as_euler("ZYX")
        return np.append(angles, control[0])
    return np.zeros(0)


@pytest.mark.parametrize("system", SYSTEMS, ids=IDS)
def test_from_state_and_input_to_the_jet_and_back(system: FlatSystem, generator: np.random.Generator) -> None:
    for _ in range(20):
        state, control = random_motion(system, generator)
        found, inputs = system.state_and_input(system.flat_jet(state, control))
        np.testing.assert_allclose(found, state, rtol=1e-12, atol=1e-12)
        # The rates come from jerks divided by the thrust: their error is relative to the largest.
        np.testing.assert_allclose(inputs, control, rtol=0, atol=1e-12 * max(1.0, np.abs(control).max()))


@pytest.mark.parametrize("system", SYSTEMS, ids=IDS)
def test_names_and_limits_fit_the_dynamics(system: FlatSystem, generator: np.random.Generator) -> None:
    state, control = random_motion(system, generator)
    assert state.shape == (len(system.states),)
    assert control.shape == (len(system.inputs),)
    assert system.derivative(state, control).shape == state.shape
    assert [len(y) for y in system.flat_jet(state, control)] == [len(system.outputs)] * (system.order + 1)
    assert [len(part) for part in system.limits()] == [len(state), len(state), len(control), len(control)]
    which, _, low, high = system.bounds
    assert len(which) == len(low) == len(high)
    assert np.nanmax(np.where(np.isfinite([low, high]), np.abs([low, high]), np.nan), axis=0) == pytest.approx(1)


@pytest.mark.parametrize("system", SYSTEMS, ids=IDS)
def test_batched_jets_equal_single_jets(system: FlatSystem, generator: np.random.Generator) -> None:
    jets = [system.flat_jet(*random_motion(system, generator)) for _ in range(6)]
    batch = [np.array(columns).reshape(2, 3, -1) for columns in zip(*jets, strict=True)]
    states, inputs = system.state_and_input(batch)
    one_state, one_input = system.state_and_input(jets[5])
    np.testing.assert_array_equal(states[1, 2], one_state)
    np.testing.assert_array_equal(inputs[1, 2], one_input)
    assert system.limited_values(batch).shape == (2, 3, len(system.bounds[0]))
    np.testing.assert_allclose(system.limited_values(batch), FlatSystem.limited_values(system, batch), rtol=1e-12)


@pytest.mark.parametrize("system", SYSTEMS, ids=IDS)
def test_the_lift_agrees_with_the_inverse(system: FlatSystem, generator: np.random.Generator) -> None:
    lift = system.lift()
    for _ in range(10):
        state, control = random_motion(system, generator)
        jet, lifted = system.flat_jet(state, control), ca.SX(lifted_unknowns(system, state, control))
        columns = [ca.SX(y) for y in jet]
        limited = np.array(ca.DM(lift.limited_quantities(columns, lifted))).ravel()
        np.testing.assert_allclose(np.array(ca.DM(lift.coupling(columns[:-1], lifted))), 0, atol=1e-12)
        of_unknowns = (
            lifted_unknowns(system, state, control)[list(lift.limited)] / system.bounds[1][: len(lift.limited)]
        )
        np.testing.assert_allclose(np.append(of_unknowns, limited), system.limited_values(jet), atol=1e-11)
        assert len(lift.names) == len(lift.low) == len(lift.high) == len(lift.rest) == len(lift.guess)


@pytest.mark.parametrize("system", [PlanarQuadrotor(), FullQuadrotor()], ids=IDS[:2])
def test_no_flight_turns_faster_than_the_turning_time(system: FlatSystem, generator: np.random.Generator) -> None:
    rate_max = 10.0
    for time in (0.005, 0.01, 0.015):
        state, control = random_motion(system, generator)
        control[1:] = np.sign(control[1:]) * rate_max

        def motion(_: float, x: Array, control: Array = control) -> Array:
            return system.derivative(x, control)

        after = solve_ivp(motion, (0, time), state, rtol=1e-10, atol=1e-10).y[:, -1]
        unknowns = [ca.SX(lifted_unknowns(system, x, control)) for x in (state, after)]
        least = np.abs(np.array(ca.DM(system.lift().turning_time(*unknowns)))).max()
        # The smoothing lengthens the chord by at most 1e-3 rad, and by far less here.
        assert least <= time + 1e-5
        assert least >= 0.5 * time


def test_the_planar_rate_is_the_time_derivative_of_the_tilt(generator: np.random.Generator) -> None:
    system = PlanarQuadrotor()
    jet = [ca.SX.sym(f"y{k}", 2) for k in range(4)]
    state, control = system.inverse(jet)
    gap = ca.Function("gap", jet, [time_derivative(state[4], jet) - control[1], time_derivative(state[:4], jet)])
    for _ in range(20):
        state_now, control_now = random_motion(system, generator)
        rate_gap, motion = gap(*system.flat_jet(state_now, control_now))
        assert abs(float(rate_gap)) < 1e-12
        np.testing.assert_allclose(np.array(motion).ravel(), system.derivative(state_now, control_now)[:4], atol=1e-12)


def test_the_planar_thrust_is_the_length_of_the_lie_derivative(generator: np.random.Generator) -> None:
    system = PlanarQuadrotor()
    for _ in range(20):
        state, control = random_motion(system, generator)
        push = system.flat_jet(state, control)[2] + [0, system.quadrotor.gravity]
        np.testing.assert_allclose(push, control[0] * np.array([np.sin(state[4]), np.cos(state[4])]), atol=1e-12)


def test_the_planar_system_moves_as_the_worlds_quadrotor_does(generator: np.random.Generator) -> None:
    vehicle = Quadrotor(thrust_max=30.0)
    for _ in range(20):
        state, control = random_motion(PlanarQuadrotor(vehicle), generator)
        expected = vehicle.derivative(state, control)
        np.testing.assert_allclose(PlanarQuadrotor(vehicle).derivative(state, control), expected, atol=1e-13)


def test_in_the_plane_and_without_yaw_the_full_quadrotor_is_the_planar_one(generator: np.random.Generator) -> None:
    for _ in range(20):
        jet = PlanarQuadrotor().flat_jet(*random_motion(PlanarQuadrotor(), generator))
        planar, (thrust, rate) = PlanarQuadrotor().state_and_input(jet)
        state, control = FullQuadrotor().state_and_input([np.array([y[0], 0.0, y[1], 0.0]) for y in jet])
        np.testing.assert_allclose(control, [thrust, 0.0, rate, 0.0], atol=1e-11)
        np.testing.assert_allclose(state[[0, 2, 3, 5]], planar[:4], atol=1e-13)
        attitude = Rotation.from_euler("y", planar[4]).as_matrix()
        np.testing.assert_allclose(state[6:].reshape(3, 3).T, attitude, atol=1e-12)


def test_a_turned_world_turns_the_full_quadrotor_with_it(generator: np.random.Generator) -> None:
    system, turn = FullQuadrotor(), 0.7
    about_z = Rotation.from_euler("z", turn).as_matrix()
    jet = system.flat_jet(*random_motion(system, generator))
    turned = [np.append(about_z @ y[:3], y[3] + (turn if k == 0 else 0)) for k, y in enumerate(jet)]
    state, control = system.state_and_input(jet)
    state_turned, control_turned = system.state_and_input(turned)
    np.testing.assert_allclose(control_turned, control, atol=1e-11)
    np.testing.assert_allclose(state_turned[6:].reshape(3, 3), state[6:].reshape(3, 3) @ about_z.T, atol=1e-12)


PATH = [Polynomial([0.2, 1.0, -0.4, 0.3, 0.1, -0.2]), Polynomial([1.0, 0.3, 0.8, -0.6, 0.2])]
TRAVEL = Polynomial([0.05, 0.6, 0.2, -0.1, 0.03])
"""s(t), increasing on [0, 1]."""


def squared_speed(t: Array) -> list[Array]:
    """Return b = s'^2 and its derivatives with respect to s up to the third, by d/ds = (1/s') d/dt."""
    v, a, j, c = (TRAVEL.deriv(k)(t) for k in range(1, 5))
    return [v**2, 2 * a, 2 * j / v, 2 * (c * v - j * a) / v**3]


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_along_a_path_is_differentiation_in_time(order: int) -> None:
    t = np.linspace(0, 1, 11)
    path = [np.stack([y.deriv(k)(TRAVEL(t)) for y in PATH], axis=-1) for k in range(order + 1)]
    jet = along_path(path, [b[:, None] for b in squared_speed(t)[:order]])
    for k in range(order + 1):
        exact = np.stack([y(TRAVEL).deriv(k)(t) for y in PATH], axis=-1)
        np.testing.assert_allclose(jet[k], exact, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PointMass(speed_max=0.0), "speed_max must be positive, got 0.0"),
        (lambda: PointMass(acceleration_max=np.nan), "acceleration_max must be positive, got nan"),
        (lambda: OverheadCrane(rope_min=-1.0), "rope_min must be positive, got -1.0"),
        (lambda: OverheadCrane(sway_max=np.nan), "sway_max must be positive, got nan"),
        (lambda: FullQuadrotor(thrust_max=9.0), "cannot hover"),
        (lambda: FullQuadrotor(thrust_max=np.inf), "cannot hover"),
        (lambda: FullQuadrotor(thrust_min=np.nan), "cannot hover"),
        (lambda: FullQuadrotor(rate_max=0.0), "rate_max must be positive and finite, got 0.0"),
        (lambda: FullQuadrotor(rate_max=np.inf), "rate_max must be positive and finite, got inf"),
    ],
)
def test_limits_that_leave_no_motion_are_refused(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()  # type: ignore[operator]
