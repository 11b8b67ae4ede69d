"""Curves y(s), and the corridors between outer paths (paper, sections II-C and II-D)."""

from optimal.paths.curves import BezierPath, BSplinePath, Path, PolynomialPath, Resting

__all__ = ["BSplinePath", "BezierPath", "Path", "PolynomialPath", "Resting"]
