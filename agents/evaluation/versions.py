"""Versions of the packages that a score depends on."""

from __future__ import annotations

import platform
from importlib.metadata import version

PACKAGES = ("flatgym", "gymnasium", "numpy", "numba", "casadi", "stable-baselines3", "torch")
"""Distributions whose versions a score records."""


def versions() -> dict[str, str]:
    """Return the versions of Python and of PACKAGES."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}
