"""The optimum: certified time-optimal flights from rest to rest, lower bounds, and the environment's fewest steps.

flights/         what a trajectory is, and its certificate: limits, replay and hoops, checked without its solver
paths/           curves y(s), and corridors between outer paths
systems/         differentially flat systems
direct/          direct multiple shooting over windings and initial guesses
flat/            the flat method, the paper's eqs. (8) and (10)
indirect/        Pontryagin's conditions
proof/           lower bounds of the flight time: the dual, branch and bound
candidates.py    the fastest flight that each method finds
minimum_time.py  `solve`: T*, by one of the three methods
discrete/        `fewest_steps`: K*, with held controls and a tolerance at the goal
batch.py         many scenarios at once, with store.py (answers on disk), parallel.py (cores), cluster.py (Ray)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from flatgym.extras import require

require("optimal", "casadi", "joblib", "numba", "scipy")

from optimal.discrete.fewest_steps import FewestSteps, fewest_steps
from optimal.flights.certificate import Certificate, certify
from optimal.flights.export import load, save
from optimal.flights.hover import HoverAtGoal
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
    "HoverAtGoal",
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

_LAZY = {
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
"""Names imported on first use: SciPy's splines, joblib and numba take longer than everything else together."""


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'optimal' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
