"""The tables of the full benchmark: every agent on every task, what is still to come, and the trainings by reward."""

import numpy as np
import pytest

from experiments.benchmark.suite import SUITES
from experiments.publishing.figures import study as study_figure
from experiments.publishing.figures.study import gaps_by_limit, profile
from experiments.publishing.study import BY_REWARD, full, ordered, over
from experiments.recipes.registry import LEARNERS
from flatgym import SCENARIOS
from tests.experiments.publishing.test_learner_tables import CONDITIONS, K_STAR, cell, point


@pytest.fixture
def results():
    curves = [[point(80, 0.5, 10), point(72, 1.0, 20)], [point(71, 1.0, 30)], [point(75, 1.0, 30), point(76, 1.0, 40)]]
    cells = [
        *(cell("hoop", "ppo", seed, {"nominal": [72]}, curve, env_steps=30) for seed, curve in enumerate(curves)),
        cell("hoop", "dqn", 0, {"nominal": [None]}, [point(250, 0.0, 9)], env_steps=9, training_s=3600.0),
        cell("hoop", "pd", steps={"nominal": [84]}),
        cell("random-goal", "dagger", 0, {"nominal": [55, 66, None, 88]}, curves[0]),
        {"problem": "random-goal", "agent": "dqn", "seed": 0, "error": "E: no", "episodes": {}, "date": "2001-02-03"},
    ]
    shared = {"smoke": False, "command": "flatquad benchmark --full", "date": "2001-02-04T05", "conditions": CONDITIONS}
    known = {"k_star": K_STAR, "validation_k_star": {"hoop": 70.0, "random-goal": 65.5}}
    return shared | known | {"cells": cells}


def lines(text, start):
    return [[part.strip() for part in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith(start)]


def test_a_cell_is_a_gap_with_what_qualifies_it(results):
    head, hoop, _ = (lines(full(results), start)[0] for start in ("| task", "| `hoop`", "| `random-goal`"))
    row = dict(zip(head, hoop, strict=True))
    assert row["PPO"] == "+2.9 %"
    assert row["DQN"] == "0 %, 1 seed"
    assert row["cascaded PD"] == "+20.0 %"
    assert row["DAgger"] == "-"
    other = dict(zip(head, lines(full(results), "| `random-goal`")[0], strict=True))
    assert other["DQN"] == "failed"
    assert other["DAgger"].startswith("+10.0 %, 75 %")


def test_what_is_not_run_yet_is_counted(results):
    wanted = SUITES["full"].cells()
    assert f"{len(wanted) - 7} of {len(wanted)} cells are not run yet" in full(results).replace("\n", " ")
    assert "1.0 h of one core" in full(results).replace("\n", " ")


def test_the_median_of_the_seeds_stands_beside_k_star(results):
    ppo, dqn = lines(full(results), "| `hoop` | 70")
    assert ppo[2:7] == ["PPO", "72, 71, 75", "72", "+2, +2.9 %", "100 %"]
    assert dqn[2:7] == ["DQN", "-", "-", "-", "0 %"]


def test_a_profile_rises_from_the_share_of_optima_to_the_success(results):
    (hoop,) = (cell for cell in results["cells"] if cell["agent"] == "pd")
    middle, low, high = profile(results | {"cells": [hoop]})
    assert middle[0] == 0  # 84 steps are 20 % more than K*
    assert middle[-1] == 1
    (dagger,) = (cell for cell in results["cells"] if cell["agent"] == "dagger")
    middle, low, high = profile(results | {"cells": [dagger]})
    assert middle[-1] == pytest.approx(0.75)
    assert (np.diff(middle) >= 0).all()
    assert ((low <= middle) & (middle <= high)).all()


def test_the_figure_has_curves_of_learners_and_profiles_of_all(results, monkeypatch):
    monkeypatch.setattr(study_figure, "LEAST_TASKS", 1)
    traces = study_figure.picture(results).data
    panels = {
        axis: {trace.name for trace in traces if trace.xaxis == axis and trace.name} for axis in ("x", "x2", "x3")
    }
    assert panels["x"] == panels["x2"] == {"PPO", "DQN", "DAgger"}
    assert panels["x3"] == {"PPO", "DQN", "DAgger", "cascaded PD"}


def test_the_median_training_counts_failures_as_infinite(results):
    ppo = [cell for cell in results["cells"] if cell["agent"] == "ppo"]
    limits = np.array([5.0, 25.0, 100.0])
    middle, low, high = gaps_by_limit(ppo, results["validation_k_star"], "samples", limits)
    assert np.isinf(middle[0])
    assert middle[2] == pytest.approx(2 / 70)
    assert ((low <= middle) & (middle <= high)).all()


def test_steps_over_k_star_are_whole_where_both_are():
    assert over(72, 70) == "+2, +2.9 %"
    assert over(72.5, 70) == "+3.6 %"
    assert over(70, 70.5) == "-0.7 %"


def test_all_agents_by_reward_are_learners_and_tasks_keep_the_order_of_the_catalogue():
    assert set(BY_REWARD) <= set(LEARNERS)
    assert ordered(["random-goal", *reversed(SCENARIOS)]) == [*SCENARIOS, "random-goal"]
