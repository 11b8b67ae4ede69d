"""Constants of the error analysis: every quantity of a proof carries a bound of its rounding error."""

UNIT_ROUNDOFF = 2.0**-53
"""Relative rounding error of one floating-point operation."""
LEAST_LENGTH = 1e-300
"""Lower bound of a length in a denominator, instead of zero."""
