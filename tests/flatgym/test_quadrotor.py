"""Laws of the exact step: it solves the ODE, composes, reverses, mirrors, and has no seam at zero rate.

State [x, z, vx, vz, theta], control [thrust, rate], as `flatgym.quadrotor` has them.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import spherical_jn

from flatgym import Quadrotor
from flatgym.quadrotor import exact_step, nearest_turn, spherical_bessel

MIRROR_STATE, MIRROR_CONTROL = np.array([-1, 1, -1, 1, -1]), np.array([1, -1])
BACKWARDS_STATE, BACKWARDS_CONTROL = np.array([1, 1, -1, -1, 1]), np.array([1, -1])
LONGEST = 0.7
"""The longest step tried [s]: more than a turn at the highest rate."""


def draw(generator, quadrotor, n):
    state = generator.normal(0, [3, 3, 5, 5, 2], (n, 5))
    control = generator.uniform(quadrotor.control_low, quadrotor.control_high, (n, 2))
    return state, control


def flown(quadrotor, state, control, h):
    """The same flights by DOP853, as one system in the share of the step flown: each ends at its own end."""

    def right_hand_side(_, parts):
        _, _, vx, vz, theta = parts.reshape(5, -1)
        thrust, rate = control.T
        slopes = (vx, vz, thrust * np.sin(theta), thrust * np.cos(theta) - quadrotor.gravity, rate)
        return (h * np.stack(np.broadcast_arrays(*slopes))).ravel()

    # The solver controls an average over all flights, so that its tolerances do not bind the worst one: hence a
    # largest share as well, in which no vehicle turns by more than 0.28 rad.
    end = solve_ivp(right_hand_side, (0, 1), state.T.ravel(), "DOP853", [1], rtol=1e-13, atol=1e-13, max_step=1 / 25)
    return end.y[:, -1].reshape(5, -1).T


def test_step_solves_the_equations_of_motion(generator, quadrotor):
    state, control = draw(generator, quadrotor, 10_000)
    h = generator.uniform(0.001, LONGEST, 10_000)
    error = np.abs(quadrotor.step(state, control, h) - flown(quadrotor, state, control, h))
    assert error.max() < 1e-12


def test_derivative_is_the_slope_of_the_step(generator, quadrotor):
    state, control = draw(generator, quadrotor, 1000)
    h = 1e-3
    points = [quadrotor.step(state, control, k * h) for k in (-2, -1, 1, 2)]
    slope = (points[0] - 8 * points[1] + 8 * points[2] - points[3]) / (12 * h)
    np.testing.assert_allclose(quadrotor.derivative(state, control), slope, atol=1e-8)


def test_steps_compose(generator, quadrotor):
    state, control = draw(generator, quadrotor, 1000)
    first, second = generator.uniform(-LONGEST, LONGEST, (2, 1000))
    twice = quadrotor.step(quadrotor.step(state, control, first), control, second)
    np.testing.assert_allclose(twice, quadrotor.step(state, control, first + second), atol=1e-12)


def test_many_small_steps_are_one(generator, quadrotor):
    state, control = draw(generator, quadrotor, 100)
    after = state
    for _ in range(500):
        after = quadrotor.step(after, control, LONGEST / 500)
    np.testing.assert_allclose(after, quadrotor.step(state, control, LONGEST), atol=1e-11)


def test_a_step_of_zero_time_is_the_identity_and_of_negative_time_the_inverse(generator, quadrotor):
    state, control = draw(generator, quadrotor, 1000)
    h = generator.uniform(0, LONGEST, 1000)
    np.testing.assert_array_equal(quadrotor.step(state, control, 0.0), state)
    np.testing.assert_allclose(quadrotor.step(quadrotor.step(state, control, h), control, -h), state, atol=1e-12)


def test_time_reversal_gives_a_solution(generator, quadrotor):
    """With velocities and rate reversed and the tilt kept, the vehicle flies back the way it came.

    Thrust is kept: acceleration does not change its sign when time does.
    """
    state, control = draw(generator, quadrotor, 1000)
    h = generator.uniform(0, LONGEST, 1000)
    end = quadrotor.step(state, control, h)
    back = quadrotor.step(end * BACKWARDS_STATE, control * BACKWARDS_CONTROL, h)
    np.testing.assert_allclose(back * BACKWARDS_STATE, state, atol=1e-12)


def test_left_and_right_are_mirror_images(generator, quadrotor):
    state, control = draw(generator, quadrotor, 1000)
    h = generator.uniform(0, LONGEST, 1000)
    mirrored = quadrotor.step(state * MIRROR_STATE, control * MIRROR_CONTROL, h)
    np.testing.assert_allclose(mirrored, quadrotor.step(state, control, h) * MIRROR_STATE, atol=1e-13)


def test_steps_are_invariant_to_translation_galilean_boost_and_whole_turns(generator, quadrotor):
    state, control = draw(generator, quadrotor, 1000)
    h = generator.uniform(0, LONGEST, 1000)
    place, speed = generator.normal(0, 5, (2, 1000, 2))
    turns = 2 * np.pi * generator.integers(-2, 3, 1000)
    moved = np.column_stack([place, speed, turns])
    carried = np.column_stack([place + speed * h[:, None], speed, turns])
    there = quadrotor.step(state + moved, control, h)
    np.testing.assert_allclose(there, quadrotor.step(state, control, h) + carried, atol=1e-12)


def test_gravity_adds_a_free_fall(generator, quadrotor):
    state, control = draw(generator, quadrotor, 1000)
    h = generator.uniform(0, LONGEST, 1000)
    weightless = Quadrotor(gravity=0.0).step(state, control, h)
    nothing, g = np.zeros(1000), quadrotor.gravity
    fall = np.column_stack([nothing, -g * h**2 / 2, nothing, -g * h, nothing])
    np.testing.assert_allclose(quadrotor.step(state, control, h), weightless + fall, atol=1e-12)


def test_energy_changes_by_the_work_of_the_thrust(generator, quadrotor):
    """Kinetic and potential energy gain the integral of thrust times the velocity along it, by Gauss's 20 points."""
    state, control = draw(generator, quadrotor, 1000)
    h = generator.uniform(0, LONGEST, 1000)

    def energy(s):
        return 0.5 * (s[:, 2] ** 2 + s[:, 3] ** 2) + quadrotor.gravity * s[:, 1]

    nodes, weights = np.polynomial.legendre.leggauss(20)
    _, _, vx, vz, theta = np.moveaxis(quadrotor.step(state, control, h * (nodes[:, None] + 1) / 2), -1, 0)
    power = control[:, 0] * (vx * np.sin(theta) + vz * np.cos(theta))
    gained = energy(quadrotor.step(state, control, h)) - energy(state)
    np.testing.assert_allclose(gained, weights @ power * h / 2, atol=1e-10)


def test_zero_rate_gives_a_parabola_and_is_the_limit_of_small_rates(generator, quadrotor):
    state, control = draw(generator, quadrotor, 1000)
    h = generator.uniform(0, LONGEST, 1000)
    control[:, 1] = 0.0
    acceleration = quadrotor.derivative(state, control)[:, 2:4]
    parabola = state.copy()
    parabola[:, 0:2] += state[:, 2:4] * h[:, None] + acceleration * h[:, None] ** 2 / 2
    parabola[:, 2:4] += acceleration * h[:, None]
    still = quadrotor.step(state, control, h)
    np.testing.assert_allclose(still, parabola, atol=1e-12)
    # Smooth in the rate: its first derivative there is at most f h^2 (or h, of the tilt), its second f h^3.
    for rate in (1e-300, 1e-12, 1e-6, 1e-3):
        left, right = (quadrotor.step(state, control + np.array([0, sign * rate]), h) for sign in (-1, 1))
        assert np.abs(right - still).max() <= rate * (quadrotor.thrust_max * LONGEST**2 + LONGEST) + 1e-14
        assert np.abs(left + right - 2 * still).max() <= rate**2 * quadrotor.thrust_max * LONGEST**3 + 1e-13


def test_batch_equals_loop_over_leading_axes(generator, quadrotor):
    state = generator.normal(size=(4, 3, 5))
    control = generator.uniform(1, 9, (3, 2))
    h = generator.uniform(0, LONGEST, (2, 1, 1))
    batch = quadrotor.step(state, control, h)
    assert batch.shape == (2, 4, 3, 5)
    for k, i, j in np.ndindex(2, 4, 3):
        np.testing.assert_allclose(batch[k, i, j], quadrotor.step(state[i, j], control[j], h[k, 0, 0]), atol=1e-14)
    slopes = quadrotor.derivative(state, control)
    np.testing.assert_array_equal(slopes[2, 1], quadrotor.derivative(state[2, 1], control[1]))


def test_step_accepts_lists_and_does_not_change_its_arguments(generator, quadrotor):
    state, control = draw(generator, quadrotor, 3)
    copies = state.copy(), control.copy()
    listed = quadrotor.step(state.tolist(), control.tolist(), [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(listed, quadrotor.step(state, control, np.array([0.1, 0.2, 0.3])))
    np.testing.assert_array_equal(state, copies[0])
    np.testing.assert_array_equal(control, copies[1])


def test_the_step_of_casadi_symbols_is_the_same(generator, quadrotor):
    """The formulas take CasADi's symbols for arrays, as the solvers need it."""
    ca = pytest.importorskip("casadi")

    class Symbols:
        sin, cos, where = ca.sin, ca.cos, ca.if_else

    parts = state, control, h = ca.SX.sym("state", 5), ca.SX.sym("control", 2), ca.SX.sym("h")
    after = exact_step(ca.vertsplit(state), ca.vertsplit(control), h, quadrotor.gravity, Symbols)
    symbolic = ca.Function("step", parts, [ca.vertcat(*after)]).map(1000)
    states, controls = draw(generator, quadrotor, 1000)
    controls[:100, 1] = 0.0
    times = generator.uniform(0, LONGEST, 1000)
    twin = symbolic(states.T, controls.T, times[None]).full().T
    np.testing.assert_allclose(twin, quadrotor.step(states, controls, times), atol=1e-12)


def test_bessel_functions_equal_those_of_scipy():
    seam = np.nextafter(0.5, [0.0, 1.0])
    a = np.concatenate([np.linspace(-4, 4, 4001), seam, -seam])
    for order, value in enumerate(spherical_bessel(a)):
        np.testing.assert_allclose(value, spherical_jn(order, a), atol=2e-15)


def test_bessel_functions_lose_no_digits_near_zero():
    assert spherical_bessel(np.array(0.0)) == (1.0, 0.0)
    small = np.array([1e-9, 1e-5, 1e-3])
    np.testing.assert_allclose(spherical_bessel(small)[1], small / 3 - small**3 / 30, rtol=1e-12)


def test_actions_map_onto_the_control_box_and_back(generator, quadrotor):
    np.testing.assert_array_equal(quadrotor.control([-1, -1]), quadrotor.control_low)
    np.testing.assert_array_equal(quadrotor.control([1, 1]), quadrotor.control_high)
    action = generator.uniform(-1, 1, (100, 2))
    np.testing.assert_allclose(quadrotor.action(quadrotor.control(action)), action, atol=1e-14)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("thrust_max", 0.5, "thrust_max must exceed thrust_min = 1.0, got 0.5"),
        ("thrust_min", -1.0, "at least 0, got -1.0"),
        ("rate_max", 0.0, "rate_max must be positive"),
        ("gravity", float("nan"), "gravity must be finite, got nan"),
        ("radius", "wide", "radius must be a number, got 'wide'"),
    ],
)
def test_invalid_vehicles_are_rejected(field, value, words):
    with pytest.raises(ValueError, match=words):
        Quadrotor(**{field: value})


def test_summed_arcs_equal_successive_steps(generator, quadrotor):
    controls = generator.uniform(quadrotor.control_low, quadrotor.control_high, (40, 2))
    dt = generator.uniform(0.001, 0.1, 40)
    states = [generator.normal(size=5)]
    for control, h in zip(controls, dt, strict=True):
        states.append(quadrotor.step(states[-1], control, h))
    np.testing.assert_allclose(quadrotor.fly(states[0], controls, dt), states, atol=1e-12)


@pytest.mark.parametrize("near", [0.0, 7.5, -20.0])
def test_the_nearest_turn_is_at_most_half_a_turn_away(generator, near):
    angle = generator.uniform(-50, 50, 1000)
    found = nearest_turn(angle, near)
    assert np.abs(found - near).max() <= np.pi + 1e-12
    np.testing.assert_allclose(np.cos(found - angle), 1, atol=1e-12)
