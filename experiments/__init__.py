"""The questions: the paper's tables, agents against the optimum, figures, and the command line."""

from flatgym.extras import require

require("experiments", "typer", "rich", "plotly", "pandas")
