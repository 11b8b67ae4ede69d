"""Experiments: the paper's tables, the benchmark of agents, measurements, figures, and the command line."""

import sys
from pathlib import Path

from flatgym.extras import require

try:
    require("experiments", "typer", "rich", "plotly", "pandas")
except ImportError as error:
    if Path(sys.argv[0]).stem == "flatquad":  # the command states what is missing, without a traceback
        sys.exit(f"failed: {error}")
    raise
