"""Random numbers by address: any order, no pattern, the same for arrays and one by one."""

import numpy as np
from scipy.stats import kstest

from flatgym.scenarios.counter_rng import DISTURBANCE, NOISE, SCENE, START, mix, normal, uniform


def addresses(count):
    return np.arange(count, dtype=np.uint64)


def test_the_finalizer_is_splitmix64():
    # Steele, Lea and Flood's generator seeded with 0 gives these two numbers first.
    golden = np.array([0x9E3779B97F4A7C15, 0x3C6EF372FE94F82A], dtype=np.uint64)
    assert [hex(value) for value in mix(golden)] == ["0xe220a8397b1dcdaf", "0x6e789e6aa1b965f4"]


def test_numbers_are_uniform_and_uncorrelated_along_every_coordinate():
    zero = np.zeros(20_000, dtype=np.uint64)
    along = addresses(20_000)
    for arguments in ((along, zero, np.uint64(0)), (zero, along, np.uint64(0)), (zero, zero, along)):
        drawn = uniform(*arguments)
        assert np.all((drawn >= 0) & (drawn < 1))
        assert kstest(drawn, "uniform").pvalue > 1e-3
        assert abs(np.corrcoef(drawn[1:], drawn[:-1])[0, 1]) < 0.03


def test_normal_numbers_are_normal():
    drawn = normal(addresses(20_000), np.uint64(3) + np.zeros(20_000, dtype=np.uint64), np.uint64(5))
    assert np.isfinite(drawn).all()
    assert kstest(drawn, "norm").pvalue > 1e-3


def test_a_number_is_a_function_of_its_address_alone():
    seeds, episodes = addresses(50), addresses(50)[::-1].copy()
    together = uniform(seeds, episodes, np.uint64(7))
    alone = [uniform(seeds[i : i + 1], episodes[i : i + 1], np.uint64(7))[0] for i in range(50)]
    np.testing.assert_array_equal(together, alone)
    assert len(set(together)) == 50


def test_streams_do_not_overlap():
    assert sorted([SCENE, DISTURBANCE, START, NOISE]) == [SCENE, DISTURBANCE, START, NOISE]
