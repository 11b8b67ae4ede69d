"""Tasks of one's own in results: their content and their best-known flight, by label.

Results name a task by `flatgym.scenarios.catalogue.label`. The labels of the named tasks say all; for the others the
results hold what is needed to draw them and to race on them.
"""

from __future__ import annotations

from collections.abc import Iterable

from agents.evaluation.optima import best_known
from experiments.files import Row, cache_folder
from flatgym import SCENARIOS, Reference, Scenario, reference
from flatgym.scenarios import catalogue
from flatgym.scenarios.files import from_dict


def own_tasks(problems: Iterable[str]) -> dict[str, Row]:
    """Return, by label, the content of each problem that has no name, and the best-known flight of a scenario.

    Args:
        problems: names, or JSON texts as `catalogue.text` returns them.
    """
    rows: dict[str, Row] = {}
    for task in map(catalogue.problem, problems):
        if catalogue.label(task) != task.name:
            best = best_known(task, cache_folder()) if isinstance(task, Scenario) else None
            rows[catalogue.label(task)] = {"content": task.to_dict(), "best": best and best.to_row()}
    return rows


def scenarios_of(results: Row) -> dict[str, tuple[Scenario, Reference]]:
    """Return the scenarios whose best flight is known, by label: the named ones, then those of the results."""
    found = {name: (scenario, best) for name, scenario in SCENARIOS.items() if (best := reference(scenario))}
    for label, row in results.get("tasks", {}).items():
        task = from_dict(row["content"])
        if isinstance(task, Scenario) and row["best"]:
            found[label] = (task, Reference.of(row["best"]))
    return found
