"""The conditions of the benchmark: how many episodes each agent flies."""

from pathlib import Path

import pytest

from experiments.benchmark.conditions import COMBINED, NOMINAL, episode_count
from experiments.recipes.run_spec import SMOKE, RunSpec


@pytest.mark.parametrize(
    ("problem", "agent", "condition", "count"),
    [
        ("hoop", "ppo", NOMINAL, 1),
        ("hoop", "ppo", COMBINED, 200),
        ("hoop", "mpc", COMBINED, 10),
        ("random-goal", "ppo", NOMINAL, 1000),
        ("random-goal", "expert", NOMINAL, 200),
        ("random-hoops", "ppo", NOMINAL, 300),
        ("random-track", "ppo", NOMINAL, 100),
        ("random-track", "ppo", COMBINED, 100),
        ("random-track", "open-loop", NOMINAL, 100),
    ],
)
def test_no_episode_on_a_distribution_is_beyond_those_with_a_shipped_k_star(problem, agent, condition, count):
    assert episode_count(RunSpec(problem, 0, Path()), agent, condition) == count


def test_the_budget_of_a_smoke_test_is_kept():
    counts = [episode_count(RunSpec("random-track", 0, Path(), SMOKE), "ppo", name) for name in (NOMINAL, COMBINED)]
    assert counts == [SMOKE.nominal_episodes, SMOKE.disturbed_episodes]
