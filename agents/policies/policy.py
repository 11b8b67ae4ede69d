"""The policy protocol: Stable-Baselines3's `predict`."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Policy(Protocol):
    """Any object with Stable-Baselines3's `predict`, recurrent and stateful policies included."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return actions (n, 2) for observations (n, 19), and the `state` for the next call.

        Args:
            observation: float32, shape (n, 19).
            state: the state that the previous call returned; None at first.
            episode_start: which episodes begin with these observations, shape (n,).
            deterministic: whether to return the mean action instead of a sample.
        """
