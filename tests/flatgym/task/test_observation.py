"""Observations: decoding inverts encoding up to the rounding of float32."""

from dataclasses import replace

import numpy as np
import pytest

from flatgym import DISTRIBUTIONS, SCENARIOS, Hoop
from flatgym.task.observation import LENGTH_UNIT, SPEED_UNIT, decode_observation, observe
from flatgym.task.scene import Scene
from flatgym.task.transition import initial

FLOAT32 = np.finfo(np.float32).eps
CASES = {
    "ground-6": SCENARIOS["ground-6"],
    "between": replace(SCENARIOS["slalom"], name="between", floor=-30.0, ceiling=20.0),
    "loop": SCENARIOS["loop"],
    "random-hoops": DISTRIBUTIONS["random-hoops"].scenario(3),
}


def agree(seen, true, unit=LENGTH_UNIT):
    """Equal but for what half a unit in the last place of l / (u + |l|) <= 1 means for l."""
    true = np.asarray(true, dtype=float)
    assert seen.shape == true.shape
    assert np.array_equal(np.isinf(seen), np.isinf(true))
    finite = np.isfinite(true)
    allowed = 0.51 * FLOAT32 * (unit + np.abs(true[finite])) ** 2 / unit
    assert np.all(np.abs(seen[finite] - true[finite]) <= allowed)


@pytest.mark.parametrize("name", CASES)
def test_decoding_inverts_encoding(name, generator):
    n, scenario = 200, CASES[name]
    scene = Scene.of([scenario]).repeat(n)
    state = generator.normal(size=(n, 5)) * [8, 8, 10, 10, 4]
    passed = generator.integers(0, len(scenario.hoops) + 1, n)
    episode = replace(initial(scene), state=state, hoops_passed=passed, steps=generator.integers(0, 250, n))
    seen = decode_observation(observe(scene, episode))
    agree(seen.goal, scene.goal - state[:, 0:2])
    agree(seen.velocity, state[:, 2:4], SPEED_UNIT)
    agree(seen.floor, state[:, 1] - scene.floor)
    agree(seen.ceiling, scene.ceiling - state[:, 1])
    np.testing.assert_allclose(np.cos(seen.theta - state[:, 4]), 1, atol=1e-12)
    np.testing.assert_allclose(seen.time * scenario.max_steps, episode.steps, atol=1e-4)
    nothing = Hoop(0.0, 0.0, 1.0)
    for i in range(2):
        hoops = [scenario.hoops[p + i] if p + i < len(scenario.hoops) else nothing for p in passed]
        there = passed + i < len(scenario.hoops)
        assert np.array_equal(seen.ahead[:, i], there)
        agree(seen.hoops[:, i], np.where(there[:, None], [hoop.centre for hoop in hoops] - state[:, 0:2], 0.0))
        agree(seen.diameters[:, i], np.where(there, [hoop.diameter for hoop in hoops], 0.0))
        direction = np.where(there[:, None], [hoop.direction for hoop in hoops], 0.0)
        np.testing.assert_allclose(seen.directions[:, i], direction, atol=FLOAT32)


def test_one_observation_decodes_as_in_a_batch():
    scene = Scene.of([SCENARIOS["hoop"]])
    observations = observe(scene, initial(scene))
    many, one = decode_observation(observations), decode_observation(observations[0])
    assert all(np.array_equal(a[0], b) for a, b in zip(many, one, strict=True))
    assert one.goal.tolist() == pytest.approx([5.0, 5.0], rel=1e-6)


def test_observations_of_another_shape_are_rejected():
    with pytest.raises(ValueError, match=r"shape \(\.\.\., 19\), got \(3, 5\)"):
        decode_observation(np.zeros((3, 5)))
