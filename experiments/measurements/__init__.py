"""Measurements of speed and correctness: solvers, environments, demonstrations, best-known solutions."""
