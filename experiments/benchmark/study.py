"""The comparison of the learners that the README prints: one suite of the benchmark.

python -m experiments.benchmark.study
python -m experiments.benchmark.study --only hoop/ppo random-goal/bc --seeds 1
python -m experiments.benchmark.study --quick
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments.benchmark import run, suite
from experiments.recipes.lesson import SMOKE
from experiments.terminal import RESULTS, progress_bar

SUITE = suite.SUITES["study"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is not done yet, and join all that is; 1 where something went wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.benchmark.study", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="PROBLEM[/AGENT]", help="those cells")
    parser.add_argument("--seeds", type=int, default=SUITE.seeds, help="trainings of each learner")
    parser.add_argument("--jobs", type=int, default=2, help="cells at a time")
    parser.add_argument("--quick", action="store_true", help="small sizes, to see that everything runs")
    parser.add_argument("--out", type=Path, help="the JSON to write; the cells are kept in a folder of its name")
    given = parser.parse_args(arguments)
    command = " ".join(["python -m experiments.benchmark.study", *(sys.argv[1:] if arguments is None else arguments)])
    out = given.out or RESULTS / f"learners{'-quick' if given.quick else ''}.json"
    asked = replace(SUITE, seeds=given.seeds)
    if given.quick:
        asked = replace(asked, name=suite.TRIAL, sizes=SMOKE)
    try:
        asked.cells(given.only)
    except ValueError as error:
        parser.error(str(error))
    with progress_bar() as bar:
        results = run.run(asked, out.with_suffix(""), command=command, bar=bar, only=given.only, jobs=given.jobs)
    failures = [f"{c['problem']}/{c['agent']}/{c['seed']}: {c['error']}" for c in results["cells"] if c.get("error")]
    print("\n".join([*failures, f"{len(results['cells'])} of {len(asked.cells())} cells written to {out}"]))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
