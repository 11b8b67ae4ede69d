"""The tables of the full benchmark (`benchmark-full.json`) and of single trainings by reward (`trainings.json`)."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from agents.evaluation.validation import best_of
from experiments.benchmark.agents import display_name, table_position
from experiments.benchmark.conditions import NOMINAL
from experiments.benchmark.formats import format_count, format_gap, format_success
from experiments.benchmark.suite import SEEDS, SUITES
from experiments.benchmark.summary import Scores, cells_of, summarise
from experiments.benchmark.trainings import position
from experiments.files import Row
from experiments.formats import format_percent, percent
from experiments.provenance import provenance_sentence
from experiments.publishing.figures.study import GAPS, LEAST_TASKS, PICTURE
from experiments.publishing.markdown import markdown, paragraph
from experiments.recipes.registry import LEARNERS

BY_REWARD = ("ppo", "dqn", "qrdqn", "sac", "td3", "tqc", "crossq", "ppo-gaussian")
"""Agents that learn by reward alone, in the order of the table."""
PACKAGES = ("flatgym", "stable-baselines3", "torch")
"""Packages whose versions are stated."""


def full(results: Row) -> str:
    """Return the gap of every agent on every task, then the table of the trainings by reward."""
    scores, errors = summarise(results), {(c["problem"], c["agent"]) for c in results["cells"] if c.get("error")}
    agents = sorted({cell["agent"] for cell in results["cells"]}, key=table_position)
    rows = [
        [f"`{problem}`", *(cell_text(results, scores, errors, problem, agent) for agent in agents)]
        for problem in ordered(results["k_star"])
    ]
    wanted = SUITES["full"].cells()
    done = {(cell["problem"], cell["agent"], cell["seed"]) for cell in results["cells"]}
    left = sum((cell.problem, cell.agent, cell.seed) not in done for cell in wanted)
    hours = sum(cell.get("training_s", 0.0) for cell in results["cells"] if cell["agent"] in LEARNERS) / 3600
    state = f"{left} of {len(wanted)} cells are not run yet and have dashes. " if left else ""
    note = (
        f"Gap to K*, the interquartile mean over the successes of {SEEDS} seeds, or of as many as are named; then the "
        f"success, where it is not 100 %. {state}The trainings took {hours:.1f} h of one core."
    )
    parts = [markdown(["task", *map(display_name, agents)], rows), paragraph(note), figure_text(), by_reward(results)]
    return "\n\n".join(parts)


def figure_text() -> str:
    """Return the figure and what it shows."""
    image = f"![Gap by samples and by training time, and performance profiles](experiments/results/published/{PICTURE})"
    note = (
        f"Left and middle: the smallest gap in validation so far, the median over the trainings on all tasks and the "
        f"quartiles. Samples are environment steps and expert labels. Right: the share of an agent's episodes with a "
        f"gap of at most so much, the mean over its tasks, with 95 % bootstrap intervals over seeds and episodes. "
        f"Agents with at least {LEAST_TASKS} tasks are drawn, without those that follow an optimal flight. Gaps below "
        f"{percent(GAPS[0])} are drawn as {percent(GAPS[0])}."
    )
    return f"{image}\n\n{paragraph(note)}"


def cell_text(results: Row, scores: Scores, errors: set[tuple[str, str]], problem: str, agent: str) -> str:
    """Return the gap of an agent on a task, with what qualifies it."""
    if (problem, agent) in errors:
        return "failed"
    score = scores.get((problem, agent, NOMINAL))
    if score is None:
        return "-"
    gap = format_gap(score, interval=False)
    parts = [gap] if gap != "-" else []
    if score["success_rate"] < 1:
        parts.append(format_success(score))
    seeds = len(cells_of(results, problem, agent))
    if agent in LEARNERS and seeds < SEEDS:
        parts.append(f"{seeds} seed" + "s" * (seeds > 1))
    return ", ".join(parts)


def by_reward(results: Row) -> str:
    """Return the table of the trainings by reward alone: the steps of each seed beside K*."""
    head = ["task", "K*", "agent", "steps by seed", "median", "over K*", "success", "env steps", "training time [s]"]
    rows = []
    for problem in ordered(results["k_star"]):
        for agent in BY_REWARD:
            cells = sorted(cells_of(results, problem, agent), key=lambda cell: int(cell["seed"]))
            if cells and not any(cell.get("error") for cell in cells):
                rows.append(reward_line(problem, agent, cells, results["validation_k_star"][problem]))
    dates = [cell["date"] for cell in results["cells"]]
    processors = ", ".join(sorted({cell["processor"] for cell in results["cells"] if cell.get("processor")}))
    where = results | {"processor": processors}  # the cells may come from several machines
    source = provenance_sentence(where, PACKAGES, command="flatquad benchmark --full", dates=dates)
    note = (
        "By reward alone: the best validation of each seed, on a distribution the mean steps of its validation "
        "episodes; medians over seeds."
    )
    return "\n\n".join([markdown(head, rows), paragraph(f"{note} {source}")])


def reward_line(problem: str, agent: str, cells: Sequence[Row], k_star: float) -> list[str]:
    """Return the line of an agent's trainings on a task."""
    best = [best_of(cell["curve"]) for cell in cells]
    steps = sorted(point["steps"] for point in best if point is not None)
    middle = median(steps) if steps else None
    return [
        f"`{problem}`",
        f"{k_star:.4g}",
        display_name(agent),
        ", ".join("-" if point is None else f"{point['steps']:.4g}" for point in best),
        "-" if middle is None else f"{middle:.4g}",
        "-" if middle is None else over(middle, k_star),
        format_percent(median(0.0 if point is None else point["success_rate"] for point in best)),
        format_count(median(cell["env_steps"] for cell in cells)),
        f"{median(cell['training_s'] for cell in cells):.0f}",
    ]


def over(steps: float, k_star: float) -> str:
    """Return how much more than K* steps are, in steps where both are whole, and in per cent."""
    whole = f"{steps - k_star:+.0f}, " if float(steps).is_integer() and float(k_star).is_integer() else ""
    return whole + percent(steps / k_star - 1, sign="+")


def ordered(problems: Sequence[str]) -> list[str]:
    """Return the tasks in the order of the catalogue, distributions last."""
    return sorted(problems, key=lambda name: (position(name), name))


def trainings(results: Row) -> str:
    """Return the table of single trainings (`experiments.benchmark.trainings`), failures included."""
    head = [
        "task", "algorithm", "changed", "seed", "success", "steps", "K*", "gap", "env steps", "wall time [s]",
        "processor",
    ]  # fmt: skip
    note = (
        "Best validation of each training, on a distribution the mean steps of its validation episodes. All fields but "
        "those changed have their defaults. Each training had one core; an asterisk marks times beside other work, "
        "which say nothing."
    )
    source = provenance_sentence(results | {"machine": {}}, PACKAGES)  # each row states its processor
    lines = [training_line(row) for row in results["trainings"]]
    return "\n\n".join([markdown(head, lines), paragraph(f"{note} {source}")])


def training_line(row: Row) -> list[str]:
    """Return the line of a training."""
    steps, k_star = row["steps"], row["k_star"]
    return [
        f"`{row['problem']}`",
        row["algorithm"],
        ", ".join(f"`{name}={value}`" for name, value in row["changed"].items()) or "-",
        str(row["seed"]),
        format_percent(row["success_rate"]),
        "-" if steps is None else f"{steps:.4g}",
        f"{k_star:.4g}",
        "-" if steps is None else percent(steps / k_star - 1, sign="+"),
        format_count(row["env_steps"]),
        f"{row['wall_time_s']:.0f}" + ("*" if row["beside_other_work"] else ""),
        row["processor"],
    ]
