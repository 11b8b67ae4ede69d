"""Observation statistics of VecNormalize, without which a policy that was trained under it acts at random.

    load_policy("ppo.zip", trust=True)                                  # finds ppo_vecnormalize.pkl beside it
    load_policy("ppo.zip", trust=True, normalize="vecnormalize.pkl")

VecNormalize keeps its means and variances outside the model's zip, in a pickle. A zip shows whether it was trained
under VecNormalize: it holds the last observations that the policy received, and off VecNormalize these are the
environment's own.
"""

from __future__ import annotations

import pickle
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.save_util import load_from_pkl
from stable_baselines3.common.vec_env import VecNormalize

from agents.policies.policy import Policy
from agents.policies.spaces import Layout, Wrapped, layout, layouts, unstacked
from flatgym.task.observation import OBSERVATION_NAMES

FILES = ("{stem}_vecnormalize.pkl", "{stem}_vec_normalize.pkl", "vecnormalize.pkl", "vec_normalize.pkl")
"""Names under which the statistics usually lie beside a zip."""
CHECKPOINT = re.compile(r"(.*)_(\d+_steps)")
"""Name of a zip of Stable-Baselines3's CheckpointCallback."""
ENV_FOLDER = "FlatQuad-v0"
"""Folder beside a zip in which RL-Zoo keeps the statistics."""
SIN, COS = OBSERVATION_NAMES.index("sin_theta"), OBSERVATION_NAMES.index("cos_theta")
ROUNDING = 1e-3
"""Largest deviation of sin^2 + cos^2 from 1 in an observation of the environment."""
FAR = 1.0
"""Difference of two states that one step cannot make in all vehicles at once."""


class PolicyWarning(UserWarning):
    """Something about a policy that its score does not show."""


class Normalized(Wrapped):
    """A policy whose observations are normalised first, with fixed statistics.

    Args:
        policy: takes normalised observations.
        statistics: the VecNormalize of its training.
        space: the space of the observations before.
        source: the file of the statistics.
    """

    def __init__(self, policy: Policy, statistics: VecNormalize, space: Any, source: Path) -> None:
        super().__init__(policy, space)
        self.statistics, self.source = statistics, source

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return actions (n, 2) for observations of shape (n, m), and the state of the policy."""
        seen = self.statistics.normalize_obs(np.asarray(observation))
        return self.policy.predict(seen, state=state, episode_start=episode_start, deterministic=deterministic)


def load_statistics(path: str | Path) -> VecNormalize:
    """Return the VecNormalize in a file that its `save` has written; this executes pickled code.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file of something else, or a damaged one.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there are no statistics of VecNormalize at {path}")
    try:
        with path.open("rb") as file:
            found = load_from_pkl(file)
    except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, ValueError, TypeError, KeyError) as error:
        raise ValueError(f"{path} does not hold statistics of VecNormalize that can be read: {error}") from error
    if not isinstance(found, VecNormalize):
        raise ValueError(
            f"{path} holds a {type(found).__name__}, not the VecNormalize of a training, as `env.save({path.name!r})` "
            "writes it"
        )
    return found


def normalized(policy: Policy, path: str | Path) -> Policy:
    """Return a policy that normalises observations as its training did, with the statistics in a file.

    VecNormalize inside VecFrameStack normalises each frame, outside it the stack; the size of its statistics tells.

    Raises:
        ValueError: for statistics of a size that does not belong to the policy's observations; as `load_statistics`.
    """
    statistics, path = load_statistics(path), Path(path)
    if not statistics.norm_obs:
        return policy
    means: Any = getattr(statistics.obs_rms, "mean", ())  # of a dictionary of observations there are several
    shape = np.shape(means)
    space = getattr(policy, "observation_space", None)
    own = layout(space) if space is not None else next(iter(layouts(shape)), Layout())
    if space is None and shape == own.single.shape:
        return Normalized(policy, statistics, own.single, path)
    if space is not None and shape == space.shape:
        return Normalized(policy, statistics, space, path)
    if own.joined and shape == own.single.shape:
        return Normalized(unstacked(policy, own), statistics, own.single, path)
    raise ValueError(
        f"the statistics of VecNormalize have shape {shape}, the policy's observations "
        f"{own.single.shape if space is None else space.shape}: they are of another training"
    )


def beside(path: str | Path) -> Path | None:
    """Return the statistics that lie beside a zip under a usual name, None if there are none."""
    path = Path(path)
    names = [name.format(stem=path.stem) for name in FILES]
    if (checkpoint := CHECKPOINT.fullmatch(path.stem)) is not None:
        names.insert(0, f"{checkpoint[1]}_vecnormalize_{checkpoint[2]}.pkl")
    places = [path.with_name(name) for name in names] + [path.parent / ENV_FOLDER / "vecnormalize.pkl"]
    return next((place for place in places if place.is_file()), None)


def with_statistics_beside(model: BaseAlgorithm, path: Path, card: dict[str, Any]) -> Policy:
    """Return a model with the statistics that lie beside its zip, if it was trained under VecNormalize.

    What was found or is missing is said in a PolicyWarning.

    Args:
        model: from the zip.
        path: the zip, whose author is trusted.
        card: its description.
    """
    place = beside(path)
    trained = card.get("normalized", False) if "flatgym" in card else was_normalized(model)  # by whom it was saved
    if trained and place is None:
        said = (
            f"{path} seems to have been trained under VecNormalize, but its statistics are not beside it: the policy "
            "sees observations unlike those of its training, and its score means little; give the statistics with "
            f"--normalize FILE, or save them as {FILES[0].format(stem=path.stem)}"
        )
    elif place is None:
        return model
    elif trained is False:
        said = f"{place} is not used: {path} was trained without VecNormalize; --normalize {place} uses it"
    else:
        said = f"observations are normalised with {place}"
    warnings.warn(said, PolicyWarning, stacklevel=2)
    return model if place is None or trained is False else normalized(model, place)


def was_normalized(model: BaseAlgorithm) -> bool | None:
    """Return whether a model was trained under VecNormalize; None if it holds no observations of its training.

    Without VecNormalize, an on-policy algorithm keeps no "original" observations, and an off-policy one keeps those of
    the step before. In features of the environment sin^2 + cos^2 is 1, in normalised ones it is not.
    """
    last, original = (getattr(model, name, None) for name in ("_last_obs", "_last_original_obs"))
    if not isinstance(last, np.ndarray):
        return None
    if not isinstance(original, np.ndarray):
        return False
    seen = layout(model.observation_space)
    newest = (last if seen.joined else last[:, -1])[:, -seen.single.shape[0] :]  # type: ignore[index]
    if seen.observation == "features":
        return bool(np.any(np.abs(np.hypot(newest[:, SIN], newest[:, COS]) - 1) > ROUNDING))
    if not isinstance(model, OffPolicyAlgorithm):
        return True
    moved = np.abs(newest - original[..., -newest.shape[1] :].reshape(newest.shape)).max(axis=1)
    return bool(np.all(moved > FAR))
