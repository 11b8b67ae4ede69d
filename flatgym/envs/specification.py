"""Gymnasium's specification of an environment as plain data.

`env.spec.to_json()` and Minari's datasets store the arguments of an environment as JSON. The environment accepts what
the JSON gives back, so `gym.make(EnvSpec.from_json(text))` makes an equal one.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from flatgym.envs.config import EnvConfig
from flatgym.scenarios.catalogue import text


def plain_spec(spec: EnvSpec | None, config: EnvConfig) -> EnvSpec | None:
    """Return a copy of a specification with plain arguments, and with the steps after which an episode is truncated."""
    if spec is None:
        return None
    kwargs = plain(spec.kwargs)
    kwargs.pop("max_episode_steps", None)  # the specification has a field for it
    if "scenario" in kwargs:
        kwargs["scenario"] = text(config.problem)  # also of a file, which may change
    return replace(spec, kwargs=kwargs, max_episode_steps=int(config.last_step))


def plain(value: Any) -> Any:
    """Return a value as dicts, lists, numbers and strings; an object with a method `to_dict` as its dict."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    return value.to_dict() if hasattr(value, "to_dict") else value
