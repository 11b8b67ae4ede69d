"""Tables: CSV and Parquet hold the numbers of the dataset."""

import numpy as np
import pandas as pd
import pytest

from agents import demonstrations
from flatgym import Scenario, observation_names

LOW = Scenario("low", (0, 0), (1, 0), floor=0.0)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_hold_the_exact_numbers(grounded, tmp_path, ending):
    dataset = demonstrations.record(LOW, grounded)
    path = demonstrations.export(dataset, tmp_path / "tables" / f"flights.{ending}")
    rows = pd.read_csv(path) if ending == "csv" else pd.read_parquet(path)
    states = ["x_m", "z_m", "vx_mps", "vz_mps", "theta_rad"]
    for number, (episode, one) in enumerate(zip(dataset.iterate_episodes(), grounded, strict=True)):
        flown = rows[rows.episode == number]
        assert flown.step.tolist() == list(range(one.steps))
        assert set(flown.seed) == {one.seed}
        assert set(flown.scenario) == {"low"}
        assert flown.terminated.tolist() == [False] * (one.steps - 1) + [True]
        assert set(flown.k_star) == {one.steps}
        np.testing.assert_allclose(flown.t_s, 0.02 * flown.step)
        np.testing.assert_array_equal(flown[states], episode.infos["state"][:-1])
        np.testing.assert_array_equal(flown[list(observation_names())].astype(np.float32), episode.observations[:-1])
        np.testing.assert_array_equal(flown[["action_0", "action_1"]].astype(np.float32), episode.actions)
        controls = one.scenario.quadrotor.control(episode.actions)
        np.testing.assert_allclose(flown[["thrust_mps2", "rate_radps"]], controls, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(flown.reward, episode.rewards)
    assert not rows.isna().any(axis=None)


def test_tables_that_cannot_be_written_are_refused(goals, tmp_path, monkeypatch):
    dataset = demonstrations.record("random-goal", goals)
    with pytest.raises(ValueError, match=r"unknown ending '.txt' of flights.txt; known: .csv, .parquet"):
        demonstrations.export(dataset, tmp_path / "flights.txt")
    monkeypatch.setattr("flatgym.extras.find_spec", lambda _: None)
    with pytest.raises(ImportError, match=r"pyarrow not installed; run: pip install 'flatgym\[parquet\]'"):
        demonstrations.export(dataset, tmp_path / "flights.parquet")
    assert not list(tmp_path.glob("flights*"))
