"""The optimum: certified flights from exact rest to exact rest, and the environment's fewest steps."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flatgym.extras import require

require("optimal", "casadi", "joblib", "numba", "scipy")

from optimal.certificate import Certificate, certify
from optimal.export import load, save
from optimal.solution import Solution, SolveFailed, Status
from optimal.solve import solve
from optimal.steps import FewestSteps, fewest_steps
from optimal.trajectory import Samples, Trajectory

if TYPE_CHECKING:
    from optimal.batch import fewest_steps_many, solve_many
    from optimal.corridors import Corridor, corridor, paper_corridor
    from optimal.following import follow
    from optimal.planning import plan
    from optimal.proof import Proof, lower_bound, prove

__all__ = [
    "Certificate",
    "Corridor",
    "FewestSteps",
    "Proof",
    "Samples",
    "Solution",
    "SolveFailed",
    "Status",
    "Trajectory",
    "certify",
    "corridor",
    "fewest_steps",
    "fewest_steps_many",
    "follow",
    "load",
    "lower_bound",
    "paper_corridor",
    "plan",
    "prove",
    "save",
    "solve",
    "solve_many",
]

_LATER = {
    "Corridor": "optimal.corridors",
    "corridor": "optimal.corridors",
    "paper_corridor": "optimal.corridors",
    "follow": "optimal.following",
    "plan": "optimal.planning",
    "fewest_steps_many": "optimal.batch",
    "solve_many": "optimal.batch",
    "Proof": "optimal.proof",
    "lower_bound": "optimal.proof",
    "prove": "optimal.proof",
}
"""Names imported when asked for: SciPy's splines, joblib and numba take longer than all the rest together."""


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'optimal' has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)
