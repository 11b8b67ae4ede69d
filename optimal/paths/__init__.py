"""Curves y(s), and the corridors between outer paths (paper, sections II-C and II-D).

chain_rule     derivatives of composed functions
curves         polynomial, B-spline and Bezier paths with exact derivatives; rest at both ends
regularity     paths with corners, and paths that stand still between their ends, are refused
gates          the usable part of each hoop, and the legs between hoops
centre_line    a curve from the start through the gates to the goal
outer_paths    outer paths around the centre line, for any scenario
corridors      `corridor` for any scenario, and the corridors printed in the paper
smoothing      a smooth motion near a flight
around         a corridor around a flight
passage        corridors that do not lead through a scenario are refused
"""

from optimal.paths.curves import BezierPath, BSplinePath, Path, PolynomialPath, Resting

__all__ = ["BSplinePath", "BezierPath", "Path", "PolynomialPath", "Resting"]
