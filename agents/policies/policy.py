"""TODO agents/policies/policy.py."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Policy(Protocol):
    """Anything with Stable-Baselines3's `predict`; recurrent and stateful policies included."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return actions (n, 2) for observations (n, 19), and what the policy wants handed back as `state`.

        Args:
            observation: float32, shape (n, 19).
            state: what the last call returned; None at first.
            episode_start: which flights begin with these observations, shape (n,).
            deterministic: whether nothing is to be drawn.
        """
