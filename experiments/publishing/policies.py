"""The table of the pretrained policies, from the cards beside them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from agents.imitation.dataset_aggregation import DaggerConfig
from agents.training.configs import PPOConfig
from experiments.benchmark.formats import format_count
from experiments.files import Row, plain
from experiments.formats import format_percent, percent
from experiments.publishing.markdown import markdown, paragraph
from experiments.recipes.pretraining import DISTRIBUTION_CONFIGS, stages_of, without_folder
from experiments.recipes.reinforcement import ppo_config
from experiments.recipes.run_spec import RunSpec
from flatgym import DISTRIBUTIONS, SCENARIOS

HEAD = ["policy", "algorithm", "success", "steps", "K*", "gap to K*", "env steps", "training time [s]", "size [kB]"]


def pretrained(folder: Path) -> str:
    """Return the table of the policies in a folder, and the commands that train them."""
    cards = [(path.stem, json.loads(path.read_text(encoding="utf-8"))) for path in sorted(folder.glob("*.json"))]
    rows = [[f"`{name}`", *score_cells(card), kilobytes(folder / f"{name}.zip")] for name, card in cards]
    return "\n\n".join([markdown(HEAD, rows), commands(cards)])


def score_cells(card: Row) -> list[str]:
    """Return the score in a card as cells."""
    score = card["score"]
    return [
        score["algorithm"],
        format_percent(score["success_rate"]),
        "-" if score["steps"] is None else f"{score['steps']:.4g}",
        f"{score['k_star']:.4g}",
        "-" if score["gap"] is None else percent(score["gap"], sign="+"),
        format_count(score["env_steps"] or 0),
        f"{score['wall_time_s']:.0f}",
    ]


def commands(cards: Sequence[tuple[str, Row]]) -> str:
    """Return the commands that train policies, and the commit of a recipe that has changed since."""
    seeds = {card["seed"] for _, card in cards}
    each = " or ".join(f"`flatquad pretrain NAME --seed {seed}`" for seed in sorted(seeds))
    older = [
        f"`{name}` has the recipe of commit {card['commit'][:7]}; today's recipe differs."
        for name, card in cards
        if card.get("commit") and not same_recipe(card, current_configs(name, card))
    ]
    return paragraph(" ".join([f"{each} trains each of them.", *older]))


def same_recipe(card: Row, today: list[Row]) -> bool:
    """Return whether a policy would be trained with today's configurations as it was.

    Fields that its card lacks did not exist and had the effect of their default. A time limit that was not reached had
    none.
    """
    seconds = card["score"]["wall_time_s"]
    filled = {kind.__name__: plain(asdict(kind())) for kind in (DaggerConfig, PPOConfig)}

    def effective(config: Row) -> Row:
        values = filled[config["kind"]] | config
        return {key: value for key, value in values.items() if key != "max_seconds" or value <= seconds}

    return [effective(config) for config in card.get("configs", [])] == [effective(config) for config in today]


def current_configs(name: str, card: Row) -> list[Row]:
    """Return the configurations that today's recipe of a policy uses, in the form of a card."""
    seed = card["seed"]
    used: Sequence[DaggerConfig | PPOConfig]
    if name in DISTRIBUTION_CONFIGS:
        used = [replace(DISTRIBUTION_CONFIGS[name], scenario=name, seed=seed)]
    elif name in DISTRIBUTIONS:
        used = [without_folder(ppo_config(RunSpec(name, seed, Path())))]
    else:
        used = [config for config, _ in stages_of(SCENARIOS[name], name, seed)]
    return [plain({"kind": type(config).__name__} | asdict(config)) for config in used]


def kilobytes(path: Path) -> str:
    """Return the size of a file in units of 1,000 bytes."""
    return f"{path.stat().st_size / 1e3:.0f}"
