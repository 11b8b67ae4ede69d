"""TODO agents/evaluation/versions.py."""

from __future__ import annotations

import platform
from importlib.metadata import version

PACKAGES = ("flatgym", "gymnasium", "numpy", "numba", "casadi", "stable-baselines3", "torch")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages a score depends on."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}
