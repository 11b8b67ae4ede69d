"""The paper rebuilt and judged: its tables, its figures, and how easily each method is initialised."""

from experiments.paper.comparison import compare
from experiments.paper.initialisation import initialisation_study
from experiments.paper.verdicts import judge, judgement

__all__ = ["compare", "initialisation_study", "judge", "judgement"]
