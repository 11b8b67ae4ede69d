"""Differentially flat systems, section II-A.

flat_system         the interface: dynamics, flat output, its inverse, limits, and the lift for programs
point_mass          a point mass with limits along each axis
planar_quadrotor    the paper's example, eqs. (3)-(5)
full_quadrotor      the quadrotor in space
overhead_crane      a trolley, a hoist and a load
"""

from optimal.systems.flat_system import FlatSystem, along_path, time_derivative
from optimal.systems.full_quadrotor import FullQuadrotor
from optimal.systems.overhead_crane import OverheadCrane
from optimal.systems.planar_quadrotor import PlanarQuadrotor
from optimal.systems.point_mass import PointMass

__all__ = [
    "FlatSystem",
    "FullQuadrotor",
    "OverheadCrane",
    "PlanarQuadrotor",
    "PointMass",
    "along_path",
    "time_derivative",
]
