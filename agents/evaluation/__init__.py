"""Scores: deterministic episodes, gaps to K*, bootstrap intervals."""
