"""Scenarios are values: they round-trip through JSON, and invalid ones are rejected with the reason."""

import math
from dataclasses import replace

import numpy as np
import pytest

import flatgym
from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario, Tolerance


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=str)
def test_named_scenarios_survive_json(scenario):
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert flatgym.scenario(scenario.to_json()) == scenario
    assert flatgym.scenario(scenario.name) is scenario


def test_all_named_scenarios_exist():
    named = "horizontal-3 horizontal-6 horizontal-9 horizontal-12 horizontal-15 ground-6 diagonal hoop climb drop"
    tracks = "high-hoop slalom loop split-s ladder figure-eight slalom-6 zigzag-12"
    assert list(SCENARIOS) == [*named.split(), *tracks.split()]


def test_catalogue_is_read_only():
    with pytest.raises(TypeError):
        SCENARIOS["mine"] = SCENARIOS["hoop"]


def test_hoop_axes_are_orthonormal_and_turn_from_x_to_z():
    hoop = Hoop(0, 0, 1, math.pi / 2)
    np.testing.assert_allclose(hoop.direction, [0, 1], atol=1e-15)
    np.testing.assert_allclose(hoop.across, [-1, 0], atol=1e-15)


def test_loop_hoops_turn_once_around():
    angles = [hoop.angle for hoop in SCENARIOS["loop"].hoops]
    assert np.isclose(np.sum((np.diff(angles) + np.pi) % (2 * np.pi) - np.pi), 2 * np.pi)


def test_unknown_scenario_names_the_nearest():
    with pytest.raises(ValueError, match=r"unknown scenario 'hop'; known: .*; did you mean 'hoop'"):
        flatgym.scenario("hop")
    with pytest.raises(TypeError, match="expected the name of a scenario, a file, a Scenario or a Distribution, got 3"):
        flatgym.scenario(3)


def plain(**changes):
    return replace(SCENARIOS["diagonal"], **changes)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: plain(goal=(5.0, math.nan)), r"goal\[1\] must be finite, got nan"),
        (lambda: plain(start=(1.0, 2.0, 3.0)), "start must be a point"),
        (lambda: plain(floor=1.0), "start lies at z = 0.0 m, below the floor at 1.0 m"),
        (lambda: plain(floor=0.0, goal=(5.0, -1.0)), "goal lies at z = -1.0 m, below the floor at 0.0 m"),
        (lambda: plain(ceiling=4.0), "goal lies at z = 5.0 m, above the ceiling at 4.0 m"),
        (lambda: plain(floor=2.0, ceiling=1.0), "ceiling must lie above the floor"),
        (lambda: plain(floor=0.0, hoops=(Hoop(2, -3, 0.5),)), r"hoops\[0\] lies wholly below the floor"),
        (lambda: plain(ceiling=5.0, hoops=(Hoop(2, 9, 0.5),)), r"hoops\[0\] lies wholly above the ceiling"),
        (lambda: plain(hoops=(Hoop(2, 2, 0.5),), quadrotor=Quadrotor(radius=0.3)), "too small for a body"),
        (lambda: plain(hoops=(Hoop(2, 2, 0.6),), quadrotor=Quadrotor(radius=0.3)), "must be at least 0.6000001 m wide"),
        (lambda: plain(hoops=(Hoop(2, 2, 9e-8),)), "a gap of 9e-08 m is too small .* at least 1e-07 m"),
        (lambda: plain(hoops=("ring",)), r"hoops\[0\] must be a Hoop, got 'ring'"),
        (lambda: plain(dt=0.0), "dt must be positive, got 0.0"),
        (lambda: plain(dt=0.7), "dt must be below 2 pi / rate_max = 0.6283 s"),
        (lambda: plain(time_limit=0.001), "time_limit must be at least dt"),
        (lambda: plain(goal=(0.05, 0.0)), "the start is already at the goal"),
        (lambda: plain(name=""), "name must be a non-empty string"),
        (lambda: plain(quadrotor=Quadrotor(thrust_max=9.0)), "cannot hover"),
        (lambda: plain(tolerance=0.1), "tolerance must be a Tolerance, got 0.1"),
        (lambda: Hoop(0, 0, -0.5), "diameter must be positive, got -0.5"),
        (
            lambda: Hoop(0, 0, 0.5, 90),
            r"Hoop.angle is in radians .* within 2 pi = 6.283, got 90; 90 degrees are 1.5708",
        ),
        (lambda: Hoop(0, 0, 0.5, -45.0), "Hoop.angle is in radians .* -45 degrees are -0.785398"),
        (lambda: Tolerance(angle=5.0), "Tolerance.angle is in radians .* within 1 pi = 3.142, got 5"),
        (lambda: Hoop(0, 0, 0.5, math.inf), "angle must be finite, got inf"),
        (lambda: Tolerance(angle=0), "angle must be positive, got 0"),
        (lambda: Scenario.from_dict({"name": "x", "colour": "red"}), "Scenario has no field 'colour'"),
    ],
)
def test_invalid_scenarios_are_rejected_with_the_reason(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_heights_are_infinite_without_floor_or_ceiling():
    free = Scenario("free", (0, 0), (1, 0))
    assert free.heights == (-math.inf, math.inf)
    assert replace(free, floor=-1.0, ceiling=2.0).heights == (-1.0, 2.0)


def test_rims_are_half_a_gap_from_the_centre_across_the_direction():
    hoop = Hoop(1.0, 2.0, 0.6, 0.3)
    np.testing.assert_allclose(hoop.rims.mean(axis=0), hoop.centre)
    np.testing.assert_allclose((hoop.rims - hoop.centre) @ hoop.direction, 0, atol=1e-15)
    np.testing.assert_allclose((hoop.rims - hoop.centre) @ hoop.across, [-0.3, 0.3])
    assert hoop.half_gap(0.1) == pytest.approx(0.2)


def test_with_diameters_changes_gap_widths_only_and_checks_them():
    scenario = SCENARIOS["slalom"]
    other = scenario.with_diameters([0.3, 0.4, 0.5])
    assert [hoop.diameter for hoop in other.hoops] == [0.3, 0.4, 0.5]
    assert other.with_diameters(hoop.diameter for hoop in scenario.hoops) == scenario
    with pytest.raises(ValueError, match="needs 3 widths, one a hoop, got 2"):
        scenario.with_diameters([0.3, 0.4])
    with pytest.raises(ValueError, match="too small for a body of radius"):
        scenario.with_diameters([0.5, 1e-8, 0.5])
    with pytest.raises(ValueError, match="too small for a body of radius"):
        replace(scenario, quadrotor=Quadrotor(radius=0.1)).with_diameters([0.5, 0.2, 0.5])


def test_narrowed_gaps_keep_a_share_of_their_free_width():
    body = replace(SCENARIOS["slalom"], quadrotor=Quadrotor(radius=0.1))
    assert [hoop.diameter for hoop in body.narrowed(0.5).hoops] == pytest.approx([0.35, 0.35, 0.35])
    assert body.narrowed(1.0).hoops == body.hoops
    assert body.narrowed(0.0).hoops[0].diameter == body.narrowest_gap == pytest.approx(0.2, abs=2e-7)
