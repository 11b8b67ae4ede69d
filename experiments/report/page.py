"""The report: one HTML file with the leaderboard, its figures, the paper's, and races against the best flights known.

    write(Path("report.html"), benchmark, paper)

The file asks for nothing: styles, scripts, data and Plotly are in it, and a policy in its head forbids all else.
Plotly is packed, and unpacked only after the page has been shown. What comes from data - names, errors, commands - is
escaped, in HTML as in scripts. Whatever number is shown stands in the data block `numbers` too, unrounded.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from html import escape
from importlib.resources import files
from math import isnan
from pathlib import Path
from string import Template
from typing import Any

from experiments.benchmark.formats import amount, gap, share, strength
from experiments.benchmark.leaderboard import Leaderboard, LeaderboardRow, board
from experiments.files import plain
from experiments.paper.tables import TABLE_I, table_1
from experiments.report.charts import DARK, Chart, of_paper, of_problem
from experiments.report.race import races
from flatgym.files import write_text

THEME = "theme.js"
SCRIPTS = ("table.js", "figures.js", "flight.js", "race.js")
"""The scripts behind the page, in the order in which they run; THEME is in its head."""
OPEN = 2
"""So many problems have their figures unfolded at first."""
COLUMNS = ("problem", "agent", "success", "gap to K*", "steps", "K*", "steps flown", "steps shown", "learning [s]")
"""Head of the leaderboard."""


@dataclass(frozen=True)
class Cell:
    """A cell of a table: what is shown, as HTML, and by what it is sorted; None stands last."""

    shown: str
    value: float | str | None


def write(path: Path, benchmark: dict[str, Any], paper: dict[str, Any]) -> Path:
    """Write the report, whole or not at all, and return its path.

    Args:
        path: the file, in a folder that exists.
        benchmark: in the format of learners.json. Its cells may hold "actions" (K, 2) of a flight to race, and an
            "error" instead of flights, which is shown.
        paper: in the format of paper.json.

    Raises:
        ValueError: for actions that cannot be flown.
        OSError: where the file cannot be written; what was there is intact.
    """
    write_text(path, page(benchmark, paper))
    return path


def page(benchmark: dict[str, Any], paper: dict[str, Any]) -> str:
    """Return the report as HTML; arguments and errors as of `write`."""
    found, rows, flights = board(benchmark), table_1(paper), races(benchmark)
    learnt = {name: of_problem(found, name, benchmark["conditions"]) for name in found.problems}
    drawn = of_paper(paper.get("judged") or [])
    ids: dict[str, Chart] = {}
    return Template(asset("report.html")).substitute(
        style=asset("report.css"),
        theme=script(THEME),
        facts=facts(benchmark),
        warning=SMALL if benchmark.get("quick") else "",
        problems=options(found.problems),
        leaderboard=table("leaderboard", COLUMNS, [scored(line) for line in found.lines]),
        charts="".join(unfolded(name, charts, ids, i < OPEN) for i, (name, charts) in enumerate(learnt.items())),
        conditions=spoken(benchmark["conditions"]),
        table_1=table("table-1", list(TABLE_I.values()), [printed(row) for row in rows]),
        paper_charts=figures("paper", drawn, ids),
        speeds=SPEEDS,
        numbers=inert(json.dumps(plain(numbers(benchmark, found, rows, flights)))),
        races=inert(json.dumps(plain(flights), separators=(",", ":"))),
        figures=inert(
            json.dumps(
                {"dark": DARK, "charts": {key: asdict(chart) for key, chart in ids.items()}}, separators=(",", ":")
            )
        ),
        plotly=packed_plotly(),
        scripts="\n".join(map(script, SCRIPTS)),
    )


SMALL = '<p class="warning">Small sizes, only to see that it runs: the numbers mean nothing.</p>'
SPEEDS = "".join(
    f'<option value="{speed}"{" selected" if speed == "0.5" else ""}>{speed}x</option>'
    for speed in ("0.1", "0.25", "0.5", "1", "2")
)


def asset(name: str) -> str:
    """Return the text of a file of the page."""
    return files("experiments").joinpath("report", name).read_text(encoding="utf-8")


def inert(data: str) -> str:
    """Return JSON that stays within its script element, whatever stands in its strings."""
    return data.replace("<", "\\u003c")


def script(name: str) -> str:
    """Return a script of the page in its element, which nothing in it ends."""
    code = asset(name).replace("</", "<\\/")
    return f"<script>\n{code}</script>"


@lru_cache(maxsize=1)
def packed_plotly() -> str:
    """Return plotly.min.js, gzip in base64: under half its size, and nothing in it that a browser could read."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode()


def numbers(
    benchmark: dict[str, Any], found: Leaderboard, rows: list[dict[str, Any]], flights: dict[str, Any]
) -> dict[str, Any]:
    """Return every number that is shown, and how the run came about."""
    return {
        "run": {key: value for key, value in benchmark.items() if key not in ("cells", "k_star")},
        "leaderboard": [asdict(line) for line in found.lines],
        "robustness": [asdict(one) for one in found.standings],
        "learning": [asdict(curve) for curve in found.curves],
        "table_1": rows,
        "races": [
            {"scenario": name} | {key: flight[key] for key in ("name", "steps", "outcome", "gap")}
            for name, scenario in flights["scenarios"].items()
            for flight in scenario["flights"]
        ],
    }


def facts(benchmark: dict[str, Any]) -> str:
    """Return command, date, machine and versions as a list of terms."""
    machine, versions = benchmark.get("machine", {}), benchmark.get("versions", {})
    cores = f"{machine['cores']} cores, " if "cores" in machine else ""
    kind = [str(value) for key, value in machine.items() if key != "cores"]
    terms = {
        "Command": f"<code>{escape(str(benchmark.get('command', '-')))}</code>",
        "Date": escape(str(benchmark.get("date", "-")).replace("T", " ").replace("+00:00", " UTC")),
        "Hardware": cores + escape(", ".join([*kind, *filter(None, [benchmark.get("processor")])])),
        "Versions": escape(", ".join(f"{name} {version}" for name, version in versions.items())),
        "Commit": f"<code>{escape(str(benchmark.get('commit') or '-'))}</code>",
    }
    return "\n".join(f"<div><dt>{term}</dt><dd>{words}</dd></div>" for term, words in terms.items())


def options(names: Iterable[str]) -> str:
    """Return the choices of a list."""
    return "".join(f'<option value="{escape(name)}">{escape(name)}</option>' for name in names)


def table(key: str, head: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """Return a table that can be sorted by each of its columns."""
    titles = "".join(f'<th scope="col"><button type="button">{escape(title)}</button></th>' for title in head)
    lines = "\n".join(f"<tr>{''.join(map(cell, head, row))}</tr>" for row in rows)
    return f'<table id="{key}"><thead><tr>{titles}</tr></thead>\n<tbody>\n{lines}\n</tbody></table>'


def cell(title: str, one: Cell) -> str:
    """Return a cell of a table; its column's title stands with it where there is no room for columns."""
    value = "" if one.value is None else escape(str(one.value))
    kind = ' class="words"' if isinstance(one.value, str) else ""
    return f'<td{kind} data-title="{escape(title)}" data-value="{value}">{one.shown}</td>'


def scored(line: LeaderboardRow) -> list[Cell]:
    """Return a line of the leaderboard: numbers, or that it failed, and what failed."""
    names = [Cell(escape(line.problem), line.problem), Cell(escape(line.name) + failures(line), line.name)]
    if line.failed:
        return [*names, Cell('<span class="failed">failed</span>', None), *[Cell("-", None)] * (len(COLUMNS) - 3)]
    row = asdict(line) | {"success_rate": line.success}
    return [
        *names,
        Cell(share(row), line.success),
        Cell(gap(row), number(line.gap)),
        Cell("-" if isnan(line.steps) else f"{line.steps:.4g}", number(line.steps)),
        Cell("-" if isnan(line.k_star) else f"{line.k_star:.4g}", number(line.k_star)),
        Cell(amount(line.env_steps), line.env_steps or None),
        Cell(amount(line.expert_steps), line.expert_steps or None),
        Cell(f"{line.learning_s:.0f}" if line.learning_s else "-", line.learning_s or None),
    ]


def failures(line: LeaderboardRow) -> str:
    """Return the errors of an agent's runs below its name."""
    return "".join(f'<small class="failed">{escape(words)}</small>' for words in line.errors)


def number(value: float) -> float | None:
    """Return a number to sort by."""
    return None if isnan(value) else value


def printed(row: dict[str, Any]) -> list[Cell]:
    """Return a line of the paper's table."""
    forms = {"printed_s": "g", "nodes_only_s": ".4f", "flat_certified_s": ".4f"}
    cells = []
    for key in TABLE_I:
        value = row[key]
        if isinstance(value, str):
            kind = ' class="failed"' if value.startswith("impossible") else ""
            cells.append(Cell(f"<span{kind}>{escape(value)}</span>", value))
        else:
            cells.append(Cell("-" if value is None else format(value, forms.get(key, ".5f")), value))
    return cells


def unfolded(problem: str, charts: dict[str, Chart], ids: dict[str, Chart], shown: bool) -> str:
    """Return the figures of a problem, which can be folded away; they are put into `ids` by their keys."""
    parts = figures(f"problem-{len(ids)}", charts, ids)
    return (
        f'<details{" open" if shown else ""}><summary>{escape(problem)}</summary><div class="grid">{parts}</div>'
        "</details>\n"
    )


def figures(prefix: str, charts: dict[str, Chart], ids: dict[str, Chart]) -> str:
    """Return places for figures, which the script draws into; they are put into `ids` by their keys."""
    parts = []
    for name, chart in charts.items():
        key = f"{prefix}-{name}"
        ids[key] = chart
        parts.append(
            f'<figure class="{name}"><div class="scroll"><div class="chart" id="{key}" role="img" '
            f'aria-label="{escape(chart.words)}"></div></div><figcaption>{chart.caption}</figcaption></figure>\n'
        )
    return "".join(parts)


def spoken(conditions: dict[str, dict[str, float]]) -> str:
    """Return what the conditions are, in words; nothing where there is none but the calm."""
    words = "; ".join(f"{escape(name)}: {escape(strength(active))}" for name, active in conditions.items() if active)
    return f"Disturbances are drawn once a flight, the same for all. {words}." if words else ""
