"""Datasets as tables, CSV or Parquet, for use without Minari.

A row is a step of an episode: state and observation, the action held during the step, and its reward. The last row of
an episode is the final state; its actions and reward are empty.

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
SUFFIXES = (".csv", ".parquet")


def export(dataset: minari.MinariDataset, path: str | Path) -> Path:
    """Write a dataset atomically to a .csv or .parquet file.

    Raises:
        ValueError: for an unknown ending.
        ImportError: for Parquet without pyarrow, with the command that installs it.
        OSError: if the file cannot be written; an older file is unchanged.
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
    """Return the path if `export` can write its format; raise the errors of `export` otherwise."""
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise ValueError(f"unknown ending {path.suffix!r} of {path.name}; known: {', '.join(SUFFIXES)}")
    if path.suffix == ".parquet":
        require("parquet", "pyarrow")
    return path


def table(dataset: minari.MinariDataset) -> pd.DataFrame:
    """Return all episodes of a dataset as one table, with K + 1 rows for each."""
    facts = dataset.storage.get_episode_metadata(dataset.episode_indices)
    names = dataset.storage.metadata["observation_names"]
    episodes = [
        _episode(number, episode, known, names)
        for number, (episode, known) in enumerate(zip(dataset.iterate_episodes(), facts, strict=True))
    ]
    return pd.concat(episodes, ignore_index=True)


def _episode(number: int, episode: minari.EpisodeData, known: dict[str, Any], names: list[str]) -> pd.DataFrame:
    scenario, count = Scenario.from_json(known["scenario"]), len(episode)
    held = _with_empty_row(episode.actions)
    columns: dict[str, Any] = {"episode": number, "step": np.arange(count + 1)}
    columns[TIME] = scenario.dt * columns["step"]
    columns |= dict(zip(STATES, episode.infos["state"].T, strict=True))
    columns |= dict(zip(CONTROLS, _with_empty_row(scenario.quadrotor.control(episode.actions)).T, strict=True))
    columns |= {f"action_{i}": held[:, i] for i in range(held.shape[1])}
    columns |= dict(zip(names, episode.observations.T, strict=True))
    columns["reward"] = _with_empty_row(episode.rewards)
    columns["k_star"] = int(known["k_star"])
    return pd.DataFrame(columns)


def _with_empty_row(values: Any) -> Any:
    """Return values of K steps, shape (K, ...), with an empty row appended for the final state."""
    return np.concatenate([values, np.full_like(values[:1], np.nan)])
