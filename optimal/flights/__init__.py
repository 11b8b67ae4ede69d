"""Trajectories, and certificates of them that share nothing with the solvers."""
