"""The report: one HTML file with the leaderboard, its charts, the paper's, and races against the best-known flights.

    write(Path("report.html"), benchmark, paper)

The file is self-contained: it holds styles, scripts, data and Plotly, and a content security policy forbids requests.
Plotly is compressed, and decompressed after the page is visible. Every number shown is also in the data block
`numbers`, unrounded.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache
from html import escape
from math import isnan
from pathlib import Path
from string import Template

from experiments.benchmark.formats import describe_disturbances, format_count, format_gap, format_success
from experiments.benchmark.leaderboard import Leaderboard, LeaderboardRow
from experiments.files import Row, plain
from experiments.paper.tables import TABLE_I, table_1
from experiments.provenance import cores
from experiments.report.chart_style import DARK
from experiments.report.charts import Chart, problem_charts
from experiments.report.elements import (
    TableCell,
    asset,
    escape_json,
    figures,
    options,
    problem_figures,
    script,
    table,
)
from experiments.report.paper_charts import paper_charts
from experiments.report.race import races
from flatgym.files import write_text

HEAD_SCRIPT = "theme.js"
SCRIPTS = ("table.js", "figures.js", "flight.js", "canvas.js", "scene.js", "traces.js", "race.js")
"""The scripts at the end of the page, in the order they run."""
OPEN_PROBLEMS = 2
"""Number of problems whose figures are open at first."""
COLUMNS = (
    "task", "agent", "success", "gap to K*", "steps", "K*", "env steps", "expert labels", "training time [s]",
)  # fmt: skip
"""Headings of the leaderboard."""
SMOKE_WARNING = '<p class="warning">Smoke test with a small budget: the numbers mean nothing.</p>'
SPEEDS = "".join(
    f'<option value="{speed}"{" selected" if speed == "0.5" else ""}>{speed}x</option>'
    for speed in ("0.1", "0.25", "0.5", "1", "2")
)


def write(
    path: Path,
    benchmark: Row,
    paper: Row,
    leaderboard: Leaderboard | None = None,
    *,
    corridors: Sequence[Row] = (),
) -> Path:
    """Write the report and return its path; a failure leaves the previous file intact.

    Args:
        path: the file, in an existing folder.
        benchmark: results in the format of learners.json. A cell may hold "actions" (K, 2) of an episode to race, and
            an "error" instead of episodes.
        paper: results in the format of paper.json.
        leaderboard: that of the benchmark, if it is known already.
        corridors: rows of the section `flat_convergence` of solvers.json.

    Raises:
        ValueError: for actions that cannot be flown.
        OSError: where the file cannot be written.
    """
    write_text(path, page(benchmark, paper, leaderboard, corridors=corridors))
    return path


def page(benchmark: Row, paper: Row, leaderboard: Leaderboard | None = None, *, corridors: Sequence[Row] = ()) -> str:
    """Return the report as HTML; arguments and errors as of `write`."""
    leaderboard = leaderboard or Leaderboard.of(benchmark)
    conditions, paper_rows, race_data = benchmark["conditions"], table_1(paper), races(benchmark)
    by_id: dict[str, Chart] = {}
    charts = "".join(
        problem_figures(problem, problem_charts(leaderboard, problem, conditions), by_id, i < OPEN_PROBLEMS)
        for i, problem in enumerate(leaderboard.problems)
    )
    of_paper = figures("paper", paper_charts(paper.get("verdicts") or [], corridors), by_id)
    return Template(asset("report.html")).substitute(
        style=asset("report.css"),
        theme=script(HEAD_SCRIPT),
        facts=run_facts(benchmark),
        warning=SMOKE_WARNING if benchmark.get("smoke") else "",
        tasks=options(leaderboard.problems),
        leaderboard=table("leaderboard", COLUMNS, [leaderboard_cells(row) for row in leaderboard.rows]),
        charts=charts,
        conditions=describe_conditions(conditions),
        table_1=table("table-1", list(TABLE_I.values()), [paper_cells(row) for row in paper_rows]),
        paper_charts=of_paper,
        speeds=SPEEDS,
        numbers=data_block(numbers(benchmark, leaderboard, paper_rows, race_data)),
        races=data_block(race_data),
        figures=data_block({"dark": DARK, "charts": {key: asdict(chart) for key, chart in by_id.items()}}),
        plotly=packed_plotly(),
        scripts="\n".join(map(script, SCRIPTS)),
    )


def data_block(data: Row) -> str:
    """Return data as JSON for a script element."""
    return escape_json(json.dumps(plain(data), separators=(",", ":")))


@lru_cache(maxsize=1)
def packed_plotly() -> str:
    """Return plotly.min.js, gzip in base64: less than half its size, and without characters special in HTML."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode()


def numbers(benchmark: Row, leaderboard: Leaderboard, paper_rows: list[Row], race_data: Row) -> Row:
    """Return every number that is shown, and the provenance of the run."""
    return {
        "run": {key: value for key, value in benchmark.items() if key not in ("cells", "k_star")},
        "leaderboard": [asdict(row) for row in leaderboard.rows],
        "robustness": [asdict(score) for score in leaderboard.scores],
        "learning": [asdict(curve) for curve in leaderboard.curves],
        "table_1": paper_rows,
        "races": [
            {"scenario": name} | {key: entry[key] for key in ("name", "steps", "outcome", "gap")}
            for name, scenario in race_data["scenarios"].items()
            for entry in scenario["entries"]
        ],
    }


def run_facts(benchmark: Row) -> str:
    """Return command, date, machine and versions as a description list."""
    machine, versions = benchmark.get("machine", {}), benchmark.get("versions", {})
    number = f"{cores(machine)}, " if "cores" in machine else ""
    kind = [str(value) for key, value in machine.items() if key != "cores"]
    facts = {
        "Command": f"<code>{escape(str(benchmark.get('command', '-')))}</code>",
        "Date": escape(str(benchmark.get("date", "-")).replace("T", " ").replace("+00:00", " UTC")),
        "Hardware": number + escape(", ".join([*kind, *filter(None, [benchmark.get("processor")])])),
        "Versions": escape(", ".join(f"{name} {version}" for name, version in versions.items())),
        "Commit": f"<code>{escape(str(benchmark.get('commit') or '-'))}</code>",
    }
    return "\n".join(f"<div><dt>{term}</dt><dd>{text}</dd></div>" for term, text in facts.items())


def leaderboard_cells(row: LeaderboardRow) -> list[TableCell]:
    """Return the cells of a leaderboard row; those of a failed agent state the failure."""
    errors = "".join(f'<small class="failed">{escape(text)}</small>' for text in row.errors)
    names = [TableCell(escape(row.problem), row.problem), TableCell(escape(row.name) + errors, row.name)]
    if row.failed:
        rest = [TableCell("-", None)] * (len(COLUMNS) - 3)
        return [*names, TableCell('<span class="failed">failed</span>', None), *rest]
    score = asdict(row) | {"success_rate": row.success}
    return [
        *names,
        TableCell(format_success(score), row.success),
        TableCell(format_gap(score), known(row.gap)),
        TableCell("-" if isnan(row.steps) else f"{row.steps:.4g}", known(row.steps)),
        TableCell("-" if isnan(row.k_star) else f"{row.k_star:.4g}", known(row.k_star)),
        TableCell(format_count(row.env_steps), row.env_steps or None),
        TableCell(format_count(row.expert_labels), row.expert_labels or None),
        TableCell(f"{row.training_s:.0f}" if row.training_s else "-", row.training_s or None),
    ]


def known(value: float) -> float | None:
    """Return a value to sort by, None for NaN."""
    return None if isnan(value) else value


def paper_cells(row: Row) -> list[TableCell]:
    """Return the cells of a row of the paper's table."""
    forms = {"printed_s": "g", "nodes_only_s": ".4f", "flat_certified_s": ".4f"}
    cells = []
    for key in TABLE_I:
        value = row[key]
        if isinstance(value, str):
            kind = ' class="failed"' if value.startswith("impossible") else ""
            cells.append(TableCell(f"<span{kind}>{escape(value)}</span>", value))
        else:
            cells.append(TableCell("-" if value is None else format(value, forms.get(key, ".5f")), value))
    return cells


def describe_conditions(conditions: dict[str, dict[str, float]]) -> str:
    """Return the disturbed conditions in words; "" for none."""
    texts = []
    for name, active in conditions.items():
        text = describe_disturbances(active)
        if text:
            texts.append(escape(text if text.startswith(name) else f"{name}: {text}").replace(" %", "&nbsp;%"))
    first = "Disturbances are sampled once for each episode and are the same for all agents: "
    return f"{first}{'; '.join(texts)}." if texts else ""
