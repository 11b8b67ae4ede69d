"""The paper's tables and figures, recomputed and verified, and how easily each method is initialised."""

from experiments.paper.comparison import compare
from experiments.paper.initialisation import initialisation_study
from experiments.paper.verdicts import check_printed_time, verdict_summary

__all__ = ["check_printed_time", "compare", "initialisation_study", "verdict_summary"]
