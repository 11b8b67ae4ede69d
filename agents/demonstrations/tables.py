"""Datasets as tables, CSV or Parquet, for those who have no Minari.

A row is an instant of an episode: the state and the observation then, the action held from then on, and the reward
of that step. In the last row of an episode, the arrival, nothing is held any more: actions and reward are empty.

    episode, step, t_s, x_m, ..., thrust_mps2, rate_radps, action_0, action_1, goal_x, ..., reward, k_star
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import minari
import numpy as np
import pandas as pd

from flatgym import Scenario
from flatgym.extras import require
from flatgym.files import write_whole
from optimal.flights.export import COLUMNS

TIME, STATES, CONTROLS = COLUMNS[0], COLUMNS[1:6], COLUMNS[6:]
ENDINGS = (".csv", ".parquet")


def export(dataset: minari.MinariDataset, path: str | Path) -> Path:
    """Write a dataset to a .csv or .parquet file, whole or not at all.

    Raises:
        ValueError: for an unknown ending.
        ImportError: for Parquet without pyarrow, with the line that installs it.
        OSError: when the file cannot be written; an older one is as it was.
    """
    path = check_export(path)
    rows = table(dataset)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".csv":
        write_whole(path, lambda temporary: rows.to_csv(temporary, index=False))
    else:
        write_whole(path, lambda temporary: rows.to_parquet(temporary, engine="pyarrow", index=False))
    return path


def check_export(path: str | Path) -> Path:
    """Return the path if `export` can write its format; raises as `export` does."""
    path = Path(path)
    if path.suffix not in ENDINGS:
        raise ValueError(f"unknown ending {path.suffix!r} of {path.name}; known: {', '.join(ENDINGS)}")
    if path.suffix == ".parquet":
        require("parquet", "pyarrow")
    return path


def table(dataset: minari.MinariDataset) -> pd.DataFrame:
    """Return all episodes of a dataset as one table, K + 1 rows each."""
    facts = dataset.storage.get_episode_metadata(dataset.episode_indices)
    names = dataset.storage.metadata["observation_names"]
    episodes = [
        _episode(number, episode, known, names)
        for number, (episode, known) in enumerate(zip(dataset.iterate_episodes(), facts, strict=True))
    ]
    return pd.concat(episodes, ignore_index=True)


def _episode(number: int, episode: minari.EpisodeData, known: dict[str, Any], names: list[str]) -> pd.DataFrame:
    scenario, count = Scenario.from_json(known["scenario"]), len(episode)
    held = _and_none(episode.actions)
    columns: dict[str, Any] = {"episode": number, "step": np.arange(count + 1)}
    columns[TIME] = scenario.dt * columns["step"]
    columns |= dict(zip(STATES, episode.infos["state"].T, strict=True))
    columns |= dict(zip(CONTROLS, _and_none(scenario.quadrotor.control(episode.actions)).T, strict=True))
    columns |= {f"action_{i}": held[:, i] for i in range(held.shape[1])}
    columns |= dict(zip(names, episode.observations.T, strict=True))
    columns["reward"] = _and_none(episode.rewards)
    columns["k_star"] = int(known["k_star"])
    return pd.DataFrame(columns)


def _and_none(values: Any) -> Any:
    """Return what was held for K steps, shape (K, ...), with an empty row for the arrival."""
    return np.concatenate([values, np.full_like(values[:1], np.nan)])
