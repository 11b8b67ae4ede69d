"""The optimum: certified flights from exact rest to exact rest, and the environment's fewest steps."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flatgym.extras import require

require("optimal", "casadi", "joblib", "numba", "scipy")

from optimal.discrete.fewest_steps import FewestSteps, fewest_steps
from optimal.flights.certificate import Certificate, certify
from optimal.flights.export import load, save
from optimal.flights.solution import Solution, SolveFailed, Status
from optimal.flights.trajectory import Samples, Trajectory
from optimal.minimum_time import solve

if TYPE_CHECKING:
    from optimal.batch import fewest_steps_many, solve_many
    from optimal.flat.following import follow
    from optimal.flat.planning import plan
    from optimal.paths.corridors import Corridor, corridor, paper_corridor
    from optimal.proof.lower_bound import Proof, lower_bound, prove

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
    "Corridor": "optimal.paths.corridors",
    "corridor": "optimal.paths.corridors",
    "paper_corridor": "optimal.paths.corridors",
    "follow": "optimal.flat.following",
    "plan": "optimal.flat.planning",
    "fewest_steps_many": "optimal.batch",
    "solve_many": "optimal.batch",
    "Proof": "optimal.proof.lower_bound",
    "lower_bound": "optimal.proof.lower_bound",
    "prove": "optimal.proof.lower_bound",
}
"""Names imported when asked for: SciPy's splines, joblib and numba take longer than all the rest together."""


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'optimal' has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)
