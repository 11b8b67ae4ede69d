"""The best-known solution of any scenario: shipped, else stored, else computed once."""

from dataclasses import replace

import numpy as np
import pytest

from agents.evaluation import optima
from agents.evaluation.optima import best_known
from agents.evaluation.optima import optima as k_star_of
from flatgym import SCENARIOS, Hoop, Scenario, reference
from optimal import fewest_steps
from optimal.store import Store

SHORT = Scenario("short", (0, 0), (1, 0))


def test_a_shipped_solution_is_found_under_any_name(monkeypatch):
    monkeypatch.setattr(optima, "fewest_steps_many", None)
    assert best_known("hoop") is best_known(replace(SCENARIOS["hoop"], name="mine")) is reference("hoop")


def test_it_is_computed_once_and_the_best_stored_one_is_taken(tmp_path, monkeypatch):
    found = best_known(SHORT, tmp_path)
    assert (found.scenario, len(found.actions)) == (f"short-{SHORT.digest[:8]}", found.k_star)
    assert np.isnan([found.time, found.time_lower_bound]).all()
    monkeypatch.setattr(optima, "fewest_steps_many", None)
    again = best_known(replace(SHORT, name="again"), tmp_path)
    assert (again.k_star, again.proven) == (found.k_star, found.proven)
    assert k_star_of(SHORT, np.arange(2), tmp_path).k_star.tolist() == [found.k_star] * 2
    worse = fewest_steps(SHORT, time_budget=0.0)
    for bound, ask in ((0, "worse"), (found.k_star, "better")):
        Store(tmp_path, {"ask": ask}).write(replace(worse, lower_bound=bound))
    assert best_known(SHORT, tmp_path).k_lower_bound == found.k_star


def test_a_scenario_without_a_flight_has_none(tmp_path):
    assert best_known(replace(SHORT, goal=(9.0, 0.0), time_limit=0.5), tmp_path) is None
    with pytest.raises(ValueError, match="is a distribution"):
        best_known("random-goal")
    assert best_known(Scenario("hoop", (0, 0), (2, 0), hoops=(Hoop(1, 0, 1),)), tmp_path).k_star < 60
