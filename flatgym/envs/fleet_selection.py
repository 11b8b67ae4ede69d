"""The choice of the fleet: compiled where numba is installed, else NumPy. Only the chosen one is imported."""

from __future__ import annotations

from importlib.util import find_spec

from flatgym.envs.config import EnvConfig
from flatgym.envs.fleet import Fleet


def make_fleet(config: EnvConfig, n: int, same_step: bool = False) -> Fleet:
    """Return a CompiledFleet where numba is installed, else a NumpyFleet."""
    if find_spec("numba") is None:
        from flatgym.envs.numpy_fleet import NumpyFleet

        return NumpyFleet(config, n, same_step)
    from flatgym.envs.compiled_fleet import CompiledFleet

    return CompiledFleet(config, n, same_step)
