"""HTML elements of the page: tables, figures, options, scripts. All text from data is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

from experiments.report.charts import Chart


@dataclass(frozen=True)
class TableCell:
    """A cell of a table: its HTML, and the value to sort by; None is sorted last."""

    html: str
    value: float | str | None


def asset(name: str) -> str:
    """Return the text of a file in this folder."""
    return files("experiments").joinpath("report", name).read_text(encoding="utf-8")


def script(name: str) -> str:
    """Return a script of this folder in its element; no string in it can end the element."""
    code = asset(name).replace("</", "<\\/")
    return f"<script>\n{code}</script>"


def escape_json(data: str) -> str:
    """Return JSON without "<", so that no string in it can end the script element around it."""
    return data.replace("<", "\\u003c")


def options(names: Iterable[str]) -> str:
    """Return the options of a select element."""
    return "".join(f'<option value="{escape(name)}">{escape(name)}</option>' for name in names)


def table(key: str, head: Sequence[str], rows: Sequence[Sequence[TableCell]]) -> str:
    """Return a table that can be sorted by each column."""
    titles = "".join(f'<th scope="col"><button type="button">{escape(title)}</button></th>' for title in head)
    lines = "\n".join(f"<tr>{''.join(map(table_cell, head, row))}</tr>" for row in rows)
    return f'<table id="{key}"><thead><tr>{titles}</tr></thead>\n<tbody>\n{lines}\n</tbody></table>'


def table_cell(title: str, cell: TableCell) -> str:
    """Return a cell of a table; on a narrow screen the title of its column is shown beside it."""
    value = "" if cell.value is None else escape(str(cell.value))
    kind = ' class="words"' if isinstance(cell.value, str) else ""
    return f'<td{kind} data-title="{escape(title)}" data-value="{value}">{cell.html}</td>'


def figures(prefix: str, charts: dict[str, Chart], by_id: dict[str, Chart]) -> str:
    """Return elements that the script draws charts into, and add the charts to `by_id`."""
    parts = []
    for name, chart in charts.items():
        key = f"{prefix}-{name}"
        by_id[key] = chart
        parts.append(
            f'<figure class="{name}"><div class="scroll"><div class="chart" id="{key}" role="img" '
            f'aria-label="{escape(chart.description)}"></div></div><figcaption>{chart.caption}</figcaption></figure>\n'
        )
    return "".join(parts)


def problem_figures(problem: str, charts: dict[str, Chart], by_id: dict[str, Chart], is_open: bool) -> str:
    """Return the figures of a problem in an element that can be collapsed, and add the charts to `by_id`."""
    parts = figures(f"problem-{len(by_id)}", charts, by_id)
    return (
        f'<details{" open" if is_open else ""}><summary>{escape(problem)}</summary><div class="grid">{parts}</div>'
        "</details>\n"
    )
