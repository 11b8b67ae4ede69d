"""Laws of the exact step: it solves the ODE, composes, reverses, mirrors, and has no seam at zero rate."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flatgym import Quadrotor
from flatgym.quadrotor import spherical_bessel


def draw(generator, quadrotor, n):
    state = generator.normal(0, [3, 3, 5, 5, 2], (n, 5))
    control = generator.uniform(quadrotor.control_low, quadrotor.control_high, (n, 2))
    return state, control


def test_step_solves_the_equations_of_motion(generator, quadrotor):
    states, controls = draw(generator, quadrotor, 40)
    for state, control, h in zip(states, controls, generator.uniform(0.001, 0.7, 40), strict=True):
        flown = solve_ivp(
            lambda _, s, control=control: quadrotor.derivative(s, control), (0, h), state, method="DOP853",
            rtol=1e-12, atol=1e-12,
        )  # fmt: skip
        np.testing.assert_allclose(quadrotor.step(state, control, h), flown.y[:, -1], atol=1e-10)


def test_steps_compose(generator, quadrotor):
    state, control = draw(generator, quadrotor, 500)
    first, second = generator.uniform(0, 0.5, (2, 500))
    twice = quadrotor.step(quadrotor.step(state, control, first), control, second)
    np.testing.assert_allclose(twice, quadrotor.step(state, control, first + second), atol=1e-12)


def test_time_runs_backwards_too(generator, quadrotor):
    state, control = draw(generator, quadrotor, 500)
    back = quadrotor.step(quadrotor.step(state, control, 0.3), control, -0.3)
    np.testing.assert_allclose(back, state, atol=1e-12)


def test_left_and_right_are_mirror_images(generator, quadrotor):
    state, control = draw(generator, quadrotor, 500)
    mirror_state, mirror_control = np.array([-1, 1, -1, 1, -1]), np.array([1, -1])
    mirrored = quadrotor.step(state * mirror_state, control * mirror_control, 0.1)
    np.testing.assert_allclose(mirrored, quadrotor.step(state, control, 0.1) * mirror_state, atol=1e-13)


def test_energy_changes_by_the_work_of_the_thrust(generator, quadrotor):
    state, control = draw(generator, quadrotor, 200)
    h = 1e-4

    def energy(s):
        return 0.5 * (s[:, 2] ** 2 + s[:, 3] ** 2) + quadrotor.gravity * s[:, 1]

    middle = quadrotor.step(state, control, h / 2)
    power = control[:, 0] * (middle[:, 2] * np.sin(middle[:, 4]) + middle[:, 3] * np.cos(middle[:, 4]))
    gained = energy(quadrotor.step(state, control, h)) - energy(state)
    np.testing.assert_allclose(gained, power * h, atol=1e-8)


def test_batch_equals_loop_over_leading_axes(generator, quadrotor):
    state = generator.normal(size=(4, 3, 5))
    control = generator.uniform(1, 9, (3, 2))
    batch = quadrotor.step(state, control, 0.02)
    assert batch.shape == (4, 3, 5)
    for i in range(4):
        for j in range(3):
            np.testing.assert_allclose(batch[i, j], quadrotor.step(state[i, j], control[j], 0.02), atol=1e-14)


def test_series_and_closed_form_of_the_bessel_functions_meet():
    a = np.array([0.5 - 1e-12, 0.5 + 1e-12])
    for below, above in np.transpose(spherical_bessel(np.stack([a, -a])), (0, 1, 2)).reshape(-1, 2):
        assert abs(below - above) < 2e-12
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
def test_impossible_vehicles_are_refused(field, value, words):
    with pytest.raises(ValueError, match=words):
        Quadrotor(**{field: value})
