"""Versions of the packages that a score depends on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("flatgym", "gymnasium", "numpy", "numba", "casadi", "stable-baselines3", "torch")
"""Distributions whose versions a score records."""
OPTIONAL = ("jax",)
"""Distributions of extras, recorded where they are installed."""


def versions() -> dict[str, str]:
    """Return the versions of Python, of PACKAGES, and of those of OPTIONAL that are installed."""
    found = {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}
    for name in OPTIONAL:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
