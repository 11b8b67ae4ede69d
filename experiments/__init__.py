"""Experiments: the paper's tables, the benchmark of agents, measurements, figures, and the command line."""

from flatgym.extras import require

require("experiments", "typer", "rich", "plotly", "pandas")
