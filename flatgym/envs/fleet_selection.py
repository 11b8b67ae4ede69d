"""The choice of the fleet: compiled where numba compiles, else NumPy. Only the chosen one is imported."""

from __future__ import annotations

from importlib.util import find_spec

from flatgym.envs.config import EnvConfig
from flatgym.envs.fleet import Fleet


def make_fleet(config: EnvConfig, n: int, same_step: bool = False) -> Fleet:
    """Return a CompiledFleet; a NumpyFleet where numba is not installed, or NUMBA_DISABLE_JIT switches it off."""
    if not compiles():
        from flatgym.envs.numpy_fleet import NumpyFleet

        return NumpyFleet(config, n, same_step)
    from flatgym.envs.compiled_fleet import CompiledFleet

    return CompiledFleet(config, n, same_step)


def compiles() -> bool:
    """Return whether numba is installed and switched on."""
    if find_spec("numba") is None:
        return False
    from numba import config

    return not getattr(config, "DISABLE_JIT", 0)  # set when numba reads its variables
