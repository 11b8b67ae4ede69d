"""TODO experiments/cli/problems.py."""

from __future__ import annotations

import numpy as np
import pandas as pd

import flatgym
from experiments.cli.options import AsJson
from experiments.cli.rows import distribution_row, scenario_row
from experiments.terminal import screen, show

EXAMPLES = "Example: flatquad list --json"


def list_problems(as_json: AsJson = False) -> None:
    """List the named scenarios, with what is known of their optima, and the distributions of random ones."""
    scenarios = [scenario_row(scenario) for scenario in flatgym.SCENARIOS.values()]
    distributions = [distribution_row(distribution) for distribution in flatgym.DISTRIBUTIONS.values()]
    if as_json:
        # Whole numbers beside None stay whole as objects only.
        show(pd.DataFrame([*scenarios, *distributions], dtype=object), as_json)
        return
    titles = {
        "scenario": "scenario",
        "goal": "goal",
        "hoops": "hoops",
        "floor": "floor",
        "time_s": "T* [s]",
        "lower_bound_s": "bound",
        "k_star": "K*",
        "proven": "proven",
    }
    known = pd.DataFrame(scenarios)
    known["time_s"] = known["time_s"].round(5)
    known["lower_bound_s"] = np.floor(known["lower_bound_s"] * 1e5) / 1e5  # rounded upwards it would be none
    show(known[list(titles)].rename(columns=titles), as_json, "Scenarios")
    screen.print(
        "T*: the fastest flight known, exactly rest to rest; none is faster than the bound. K*: the fewest environment "
        "steps known, tolerance at the goal; proven if no flight takes fewer.\n",
        markup=False,
    )
    titles = {"scenario": "distribution", "goal": "goal, drawn for each episode", "hoops": "hoops"}
    show(pd.DataFrame(distributions)[list(titles)].rename(columns=titles), as_json, "Distributions")
