"""Agents compared: suites of cells, their results and the leaderboard."""
