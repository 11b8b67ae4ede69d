"""Colours, labels, error bars and axes of the report's charts.

Colours are those of the light theme; DARK maps each to its counterpart in the dark theme. Plotly interprets some HTML,
so names are escaped.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import plotly.graph_objects as go

from experiments.benchmark.agents import LEARNER_COLOURS, NAMES
from experiments.figures import COLOURS, FAINT, FLAME, FURTHER_COLOURS, INK, OUTLINE

EXTERNAL_COLOURS = ("#12807a", "#b0487f", "#5a67c4", "#8a6d1f")
"""Colours of external policies and pretrained ones."""
DARK = {
    INK: "#dbe4ec",
    OUTLINE: "#84929e",
    FAINT: "#2a343d",
    FLAME: "#f0b352",
    "white": "#12171c",
    **dict(zip(COLOURS, ("#55b7e0", "#f08a68", "#93c267", "#c795d6"), strict=True)),
    **dict(
        zip(
            FURTHER_COLOURS,
            ("#9fd0e6", "#d9705f", "#f5b8a6", "#c2ae8c", "#bfe09a", "#dcc0e6", "#74d6c9", "#e8a8cc"),
            strict=True,
        )
    ),
    **dict(zip(EXTERNAL_COLOURS, ("#4cc2ba", "#e585b6", "#98a2f0", "#cfae58"), strict=True)),
}
"""The dark theme's colours, by colour of the light theme."""
GREY_AGENTS = tuple(agent for agent in NAMES if agent not in LEARNER_COLOURS and agent != "pretrained")
"""Agents without training."""
LABEL_LENGTH = 26
"""Most characters of a name beside an axis."""
SUBPLOT_FONT = {"size": 16}
"""Plotly's font of subplot titles, which is too large for a phone."""


def agent_colours(agents: Iterable[str]) -> dict[str, str]:
    """Return the colours of agents: learners as in the README, grey for experts, others in the order given."""
    known = dict.fromkeys(agents)
    others = [agent for agent in known if agent not in LEARNER_COLOURS and agent not in GREY_AGENTS]
    fresh = {agent: EXTERNAL_COLOURS[i % len(EXTERNAL_COLOURS)] for i, agent in enumerate(others)}
    return {agent: LEARNER_COLOURS.get(agent) or fresh.get(agent, OUTLINE) for agent in known}


def label(name: str) -> str:
    """Return a name as Plotly writes it beside an axis: escaped, and shortened where it is too long."""
    return escape(name if len(name) <= LABEL_LENGTH else name[: LABEL_LENGTH - 1] + "…")


def plain_figure(figure: go.Figure) -> dict[str, Any]:
    """Return data and layout of a figure as JSON values, without the title, size and fonts, which the page sets."""
    content: dict[str, Any] = json.loads(figure.to_json())
    for key in ("template", "title", "width", "height", "font", "margin"):
        content["layout"].pop(key, None)
    for annotation in content["layout"].get("annotations", ()):
        if annotation.get("font") == SUBPLOT_FONT:
            del annotation["font"]
    return {"data": content["data"], "layout": content["layout"]}


def error_bars(values: Sequence[float], lows: Sequence[float], highs: Sequence[float]) -> dict[str, Any]:
    """Return the error bars of intervals; one that does not contain its value is cut off at the value."""
    return {
        "type": "data",
        "symmetric": False,
        "array": [max(high - value, 0.0) for value, high in zip(values, highs, strict=True)],
        "arrayminus": [max(value - low, 0.0) for value, low in zip(values, lows, strict=True)],
        "color": INK,
        "thickness": 1.3,
        "width": 4,
    }


def use_name_axis(figure: go.Figure, names: Sequence[str]) -> None:
    """Make the vertical axis one of names, the first on top."""
    figure.update_yaxes(
        type="category", categoryorder="array", categoryarray=names, range=[len(names) - 0.4, -0.6],
        automargin=True, ticklabelstandoff=6,
    )  # fmt: skip
