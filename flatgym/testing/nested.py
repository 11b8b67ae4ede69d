"""Comparison and modification of nested values: arrays in dicts, tuples and lists, to any depth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray


def difference(name: str, got: Any, wanted: Any, atol: float) -> tuple[str, Any, Any] | None:
    """Return the place of the first difference and both values there, or None; numbers may differ by atol."""
    if isinstance(got, dict) and isinstance(wanted, dict):
        if got.keys() != wanted.keys():
            return f"the list of keys of {name}", sorted(got), sorted(wanted)
        parts = [(f"{name}[{key!r}]", got[key], wanted[key]) for key in wanted]
    elif isinstance(got, (tuple, list)) and isinstance(wanted, (tuple, list)):
        if len(got) != len(wanted):
            return f"the length of {name}", len(got), len(wanted)
        parts = [(f"{name}[{i}]", one, other) for i, (one, other) in enumerate(zip(got, wanted, strict=True))]
    else:
        return _array_difference(name, got, wanted, atol)
    return next(filter(None, (difference(*part, atol) for part in parts)), None)


def _array_difference(name: str, got: Any, wanted: Any, atol: float) -> tuple[str, Any, Any] | None:
    one, other = np.asarray(got), np.asarray(wanted)
    if one.shape != other.shape:
        return f"the shape of {name}", one.shape, other.shape
    if one.dtype == object and one.ndim:
        return difference(name, one.tolist(), other.tolist(), atol)
    equal = np.asarray(one == other)
    kinds = {one.dtype.kind, other.dtype.kind}
    if "f" in kinds and kinds <= set("fiub") and not equal.all():
        coarsest = max(float(np.finfo(a.dtype).eps) for a in (one, other) if a.dtype.kind == "f")
        rounding = coarsest if atol > 0 and coarsest > np.finfo(np.float64).eps else 0.0
        equal = np.isclose(one.astype(np.float64), other.astype(np.float64), rounding, atol, equal_nan=True)
    if equal.all():
        return None
    at = tuple(int(k) for k in np.argwhere(~equal)[0])
    return name + (str(list(at)) if at else ""), one[at].item(), other[at].item()


def _arrays(value: Any) -> Iterator[NDArray[Any]]:
    """Yield all numeric arrays of a nested value."""
    if isinstance(value, (dict, tuple, list)):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _arrays(part)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        yield value


def overwrite(value: Any) -> None:
    """Write other numbers into all writable arrays of a nested value, once into each."""
    for array in {id(array): array for array in _arrays(value)}.values():
        if array.flags.writeable:
            array[...] = np.nan if array.dtype.kind == "f" else ~array


def replace_rows(single: gym.Space[Any], own: Any, other: Any, rows: NDArray[np.bool_]) -> Any:
    """Return the batched actions `own` with the masked rows, shape (n,), replaced by those of `other`."""
    if isinstance(single, gym.spaces.Dict):
        return {key: replace_rows(part, own[key], other[key], rows) for key, part in single.items()}
    if isinstance(single, gym.spaces.Tuple):
        return tuple(replace_rows(part, own[k], other[k], rows) for k, part in enumerate(single.spaces))
    if isinstance(own, np.ndarray):
        mask = rows.reshape(-1, *[1] * (own.ndim - 1))
        return np.where(mask, other, own).astype(own.dtype)
    return tuple(stray if row else action for row, stray, action in zip(rows, other, own, strict=True))
