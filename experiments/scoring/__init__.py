"""Scores of single policies: a submission is flown and scored, written to a file, and verified from it."""
