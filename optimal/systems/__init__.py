"""Differentially flat systems, one a file; see `optimal.systems.flat_system` for the interface."""

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
