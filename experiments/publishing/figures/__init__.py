"""The figures and pictures of README and docs."""
