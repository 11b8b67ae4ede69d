"""Datasets as tables, CSV or Parquet, for use without Minari.

A row is a step of an episode: the state and observation at its start, the action held during it, its reward, and
whether it ends the episode at the goal. The state after the last step is in the dataset only.

    episode, seed, scenario, step, t_s, x_m, ..., thrust_mps2, rate_radps, action_0, action_1, goal_x, ..., reward,
    terminated, k_star
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
    """Return all episodes of a dataset as one table, with K rows for each."""
    facts = dataset.storage.get_episode_metadata(dataset.episode_indices)
    names = dataset.storage.metadata["observation_names"]
    episodes = [
        _episode(number, episode, known, names)
        for number, (episode, known) in enumerate(zip(dataset.iterate_episodes(), facts, strict=True))
    ]
    return pd.concat(episodes, ignore_index=True)


def _episode(number: int, episode: minari.EpisodeData, known: dict[str, Any], names: list[str]) -> pd.DataFrame:
    scenario, steps = Scenario.from_json(known["scenario"]), np.arange(len(episode))
    columns: dict[str, Any] = {"episode": number, "seed": known["seed"], "scenario": scenario.name, "step": steps}
    columns[TIME] = scenario.dt * steps
    columns |= dict(zip(STATES, episode.infos["state"][:-1].T, strict=True))
    columns |= dict(zip(CONTROLS, scenario.quadrotor.control(episode.actions).T, strict=True))
    columns |= {f"action_{i}": action for i, action in enumerate(episode.actions.T)}
    columns |= dict(zip(names, episode.observations[:-1].T, strict=True))
    columns |= {"reward": episode.rewards, "terminated": episode.terminations, "k_star": int(known["k_star"])}
    return pd.DataFrame(columns)
