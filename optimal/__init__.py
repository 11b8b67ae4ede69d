"""The optimum: certified flights from exact rest to exact rest, and the environment's fewest steps."""

from flatgym.extras import require

require("optimal", "casadi", "scipy")

from optimal.bounds import projection_bound as lower_bound
from optimal.certificate import Certificate, certify
from optimal.export import load, save
from optimal.planning import plan
from optimal.solution import Solution, SolveFailed, Status
from optimal.solve import solve
from optimal.steps import FewestSteps, fewest_steps
from optimal.trajectory import Samples, Trajectory

__all__ = [
    "Certificate",
    "FewestSteps",
    "Samples",
    "Solution",
    "SolveFailed",
    "Status",
    "Trajectory",
    "certify",
    "fewest_steps",
    "load",
    "lower_bound",
    "plan",
    "save",
    "solve",
]
