"""What a policy answered, as actions: arrays, lists, and tensors with or without gradient; anything else is named."""

from __future__ import annotations

import reprlib
from typing import Any

import numpy as np
from numpy.typing import NDArray


class PolicyFailed(ValueError):
    """A policy raised an error, or returned invalid actions."""


class OneForMany(PolicyFailed):
    """A policy returned one action for many observations."""


def as_actions(answer: Any, count: int | None, name: str) -> NDArray[np.float64]:
    """Return actions of shape (n, 2), or (2,) for a single observation without a batch axis.

    Args:
        answer: what the policy returned, without its state.
        count: n, or None for a single observation.
        name: the policy's name in error messages.

    Raises:
        PolicyFailed: for an answer of another shape or type, and for NaN and infinity; names what was wanted.
    """
    wanted = (2,) if count is None else (count, 2)
    values = as_array(answer)
    if values.dtype.kind not in "fiu":
        raise PolicyFailed(
            f"{name} returned {reprlib.repr(answer)}, which is not an array of actions; wanted numbers, {wanted}"
        )
    if values.shape == (2,) and count is not None and count > 1:
        raise OneForMany(
            f"{name} returned one action, of shape (2,), for {count} observations; wanted {wanted}, one for each"
        )
    if values.shape != wanted and not (values.shape in ((2,), (1, 2)) and count in (None, 1)):
        raise PolicyFailed(
            f"{name} returned actions of shape {values.shape} for "
            f"{'one observation' if count is None else f'{count} observations'}; wanted {wanted}"
        )
    actions = values.reshape(wanted).astype(np.float64)
    if not np.isfinite(actions).all():
        first = int(np.flatnonzero(~np.isfinite(actions.reshape(-1, 2)).all(axis=1))[0])
        raise PolicyFailed(
            f"{name} returned the action {actions.reshape(-1, 2)[first].tolist()} for observation {first} of "
            f"{count or 1}; both numbers must be finite"
        )
    return actions


def as_array(answer: Any) -> NDArray[Any]:
    """Return an answer as an array; one of dtype object if it is none."""
    if isinstance(answer, (list, tuple)):
        answer = [_off_torch(one) for one in answer]
    try:
        return np.asarray(_off_torch(answer))
    except (TypeError, ValueError, RuntimeError):  # ragged lists, and what refuses to become an array
        return np.empty((), dtype=object)


def one_of(answers: Any, count: int) -> NDArray[Any]:
    """Return the only answer of a network that has the shape (count, 2).

    Raises:
        PolicyFailed: if none or several of its answers have it.
    """
    every = answers if isinstance(answers, (list, tuple)) else [answers]
    arrays = [as_array(one) for one in every]
    fitting = [one for one in arrays if one.shape == (count, 2)]
    if len(fitting) != 1:
        shapes = ", ".join(str(one.shape) if one.dtype != object else type(one).__name__ for one in arrays)
        raise PolicyFailed(
            f"the network returned {len(arrays)} values, of shapes {shapes or 'none'}; wanted one of shape ({count}, 2)"
        )
    return fitting[0]


def shorten(error: BaseException) -> str:
    """Return an error in one line, without the traceback that torch appends."""
    text = str(error)
    cause = text.rpartition("RuntimeError: ")[2] if "TorchScript interpreter" in text else text
    return f"{type(error).__name__}: {next(iter(cause.strip().splitlines()), '')}"


def _off_torch(value: Any) -> Any:
    """Return a torch tensor as an array, and anything else as it is."""
    return value.detach().cpu().numpy() if hasattr(value, "detach") and hasattr(value, "cpu") else value
