"""Constants of the error analysis: every quantity of a proof carries a bound of its rounding error."""

UNIT_ROUNDOFF = 2.0**-53
"""Relative rounding error of one floating-point operation."""
LEAST_LENGTH = 1e-300
"""Lower bound of a length in a denominator, instead of zero."""
TIME_MARGIN = 1e-9
"""Margin of times and distances that are rounded outwards, relative to the duration or to the coordinates."""
