"""Arrays of NumPy, PyTorch and JAX: their namespace, and what the array API standard leaves out.

The task is written once, over the array API standard. `namespace` returns the functions of the library to which the
arrays of a call belong: NumPy's own module, which follows the standard, `jax.numpy`, which does too, and the wrapper of
`array-api-compat` for PyTorch and others. Neither PyTorch nor JAX is imported before an array of theirs arrives.

The standard has no loops of data-dependent length, which the search for events needs. `repeat` and `where_rare` provide
them: plain Python where arrays have values, loops of the library and fixed shapes where `jax.jit` or `torch.compile`
traces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from flatgym.extras import require

EXTRAS = {"torch": "torch", "jax": "jax", "jaxlib": "jax"}
"""The extra that installs a library, by the module of its arrays."""
MODULES = {"torch": "array_api_compat.torch", "jax": "jax.numpy"}
"""Modules of the namespaces that are imported when they are needed."""
NAMESPACES: dict[str, Any] = {"numpy": np}
"""Those that are imported; `torch.compile` traces a look-up, not an import."""
CHUNKS, LEAST_CHUNK = 16, 64
"""Under a trace of JAX, rare rows are handled in chunks: of 1/CHUNKS of all rows, at least LEAST_CHUNK."""


def library(array: Any) -> str:
    """Return the name of the library of an array, "numpy", "torch" or "jax"; the module's name for any other."""
    if isinstance(array, (np.ndarray, np.generic)):
        return "numpy"
    root = type(array).__module__.partition(".")[0]
    if root not in EXTRAS and hasattr(array, "__torch_function__"):  # subclasses of tensors
        return "torch"
    return EXTRAS.get(root, root)


def namespace(*arrays: Any) -> Any:
    """Return the array API namespace of the arrays of one call.

    Raises:
        TypeError: for arrays of different libraries.
        ImportError: with the pip command, if an extra is missing.
    """
    name = library(arrays[0])
    for other in arrays[1:]:
        if library(other) != name:
            names = ", ".join(library(array) for array in arrays)
            raise TypeError(
                f"the arrays of one call must belong to one library, got {names}; move a scene with "
                "Scene.to(xp=...), an episode state with EpisodeState.to(xp=...)"
            )
    if name not in NAMESPACES:
        require(EXTRAS.get(name, "torch"), "array_api_compat")
        if name not in MODULES:
            return import_module("array_api_compat").array_namespace(arrays[0])
        NAMESPACES[name] = import_module(MODULES[name])
    return NAMESPACES[name]


def check_arrays(**arrays: Any) -> None:
    """Check the arrays of one call: floating point of single or double precision, on one device.

    Raises:
        TypeError: for integers, half precision, and arrays that are not floating point at all.
        ValueError: for arrays on different devices.
    """
    devices = {}
    for name, array in arrays.items():
        kind = str(array.dtype).removeprefix("torch.")
        if kind not in ("float32", "float64"):
            raise TypeError(f"{name} must be float64 or float32, got {kind}; convert it before the call")
        if library(array) == "torch":
            devices[name] = str(array.device)
    if len(set(devices.values())) > 1:
        where = ", ".join(f"{name} on {device}" for name, device in devices.items())
        raise ValueError(f"the arrays of one call must be on one device, got {where}; move them with .to(device)")


def convert(array: Any, xp: Any = np, dtype: Any = None, device: Any = None) -> Any:
    """Return an array in another library.

    Args:
        array: numbers of any library.
        xp: the module of the library: numpy, torch or jax.numpy.
        dtype: that of floating point numbers, xp.float64 or xp.float32; by default the array's own where the library
            has it. JAX has float64 only with `jax.config.update("jax_enable_x64", True)`.
        device: a device of the library; by default the one it uses for new arrays.
    """
    host = array.detach().cpu().numpy() if library(array) == "torch" else np.asarray(array)
    if host.dtype.kind != "f":
        dtype = None
    where = {} if device is None else {"device": device}
    return xp.asarray(host, dtype=dtype, **where)


def is_jax(xp: Any) -> bool:
    """Return whether a module is `jax.numpy`."""
    return xp.__name__ == "jax.numpy"


@cache
def register_pytree(kind: type, static: tuple[str, ...] = ()) -> None:
    """Register a dataclass as a pytree of JAX, once; the fields `static` are no arrays."""
    arrays = [field.name for field in fields(kind) if field.name not in static]
    import_module("jax").tree_util.register_dataclass(kind, arrays, list(static))


def as_array(value: Any) -> Any:
    """Return an array of PyTorch or JAX as it is, and anything else as an array of NumPy, float64."""
    return value if library(value) in ("torch", "jax") else np.asarray(value, dtype=np.float64)


def like(array: Any) -> dict[str, Any]:
    """Return dtype and device of an array, as keywords of array-creating functions."""
    return {"dtype": array.dtype} | on_device_of(array)


def on_device_of(array: Any) -> dict[str, Any]:
    """Return the device of an array, as a keyword; nothing for NumPy, and for JAX, which places arrays itself."""
    return {} if library(array) in ("numpy", "jax") else {"device": array.device}


def constant(value: Any) -> Any:
    """Return an array, through which no gradient flows."""
    name = library(value)
    if name == "torch":
        return value.detach()
    return import_module("jax").lax.stop_gradient(value) if name == "jax" else value


def hypot(x: Any, z: Any) -> Any:
    """Return sqrt(x^2 + z^2), with the gradient 0 at the origin, where there is none."""
    if isinstance(x, np.ndarray):
        return np.hypot(x, z)
    xp = namespace(x)
    zero = (x == 0) & (z == 0)
    return xp.where(zero, xp.zeros_like(x), xp.hypot(xp.where(zero, xp.ones_like(x), x), z))


def compiles(array: Any) -> bool:
    """Return whether `torch.compile` traces a function of this array."""
    return library(array) == "torch" and NAMESPACES["torch"].compiler.is_compiling()


def repeat(goes_on: Callable[..., Any], change: Callable[..., tuple[Any, ...]], *values: Any) -> tuple[Any, ...]:
    """Return values after `values = change(*values)` as long as `goes_on(*values)` is true, a scalar array."""
    if library(values[0]) == "jax":
        lax = import_module("jax").lax
        return lax.while_loop(lambda now: goes_on(*now), lambda now: change(*now), values)
    if compiles(values[0]):
        result: tuple[Any, ...] = NAMESPACES["torch"].while_loop(goes_on, change, values)
        return result
    while goes_on(*values):
        values = change(*values)
    return values


def where_rare(mask: Any, compute: Callable[..., Any], default: Any, *arrays: Any) -> Any:
    """Return `compute(*arrays)` where the mask holds and `default` elsewhere, computed for those rows only.

    Args:
        mask: shape (n,).
        compute: a function that handles each row by itself; takes rows of the arrays, returns an array (m, ...).
        default: shape (n, ...).
        arrays: shapes (n, ...).
    """
    if library(mask) == "jax":
        return _where_rare_traced(mask, compute, default, arrays)
    xp = namespace(mask)
    if compiles(mask):
        values = compute(*arrays)
        return xp.where(xp.reshape(mask, (-1, *(1,) * (values.ndim - 1))), values, default)
    (rows,) = xp.nonzero(mask)
    if not rows.shape[0]:
        return default
    result = xp.asarray(default, copy=True)
    result[rows] = compute(*(array[rows] for array in arrays))
    return result


def _where_rare_traced(mask: Any, compute: Callable[..., Any], default: Any, arrays: tuple[Any, ...]) -> Any:
    """Compute chunk after chunk until no row is left; all shapes are fixed."""
    jax = import_module("jax")
    jnp, n = jax.numpy, mask.shape[0]
    size = min(n, max(LEAST_CHUNK, -(-n // CHUNKS)))

    def compute_chunk(left: Any, result: Any) -> tuple[Any, Any]:
        (rows,) = jnp.nonzero(left, size=size, fill_value=n)  # rows that do not exist are dropped below
        values = compute(*(array.at[rows].get(mode="clip") for array in arrays))
        return left.at[rows].set(False, mode="drop"), result.at[rows].set(values, mode="drop")

    return repeat(lambda left, _: left.any(), compute_chunk, mask, default)[1]
