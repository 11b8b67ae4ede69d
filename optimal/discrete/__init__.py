"""Fewest environment steps K*: controls held for dt, tolerance at the goal."""
