"""The tables of the agents: the quick benchmark (`benchmark.json`) and the comparison of all agents (`learners.json`).

Success and gap have bootstrap intervals over seeds and episodes (`agents.evaluation.bootstrap`). Under disturbances
the gap is to K* of the nominal vehicle; with a tail wind it can be negative.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isinf

import numpy as np

from experiments.benchmark.agents import display_name, table_position
from experiments.benchmark.conditions import COMBINED, NOMINAL
from experiments.benchmark.formats import describe_disturbances, format_count, format_gap, format_success, join_names
from experiments.benchmark.shipped import EARLIER, shown_name
from experiments.benchmark.summary import (
    TARGET_GAP,
    TARGET_SUCCESS,
    Scores,
    cells_of,
    pairs,
    samples_to_target,
    summarise,
)
from experiments.benchmark.work import SAMPLES, SECONDS, gaps_by_work
from experiments.files import Row
from experiments.formats import percent
from experiments.provenance import provenance_sentence
from experiments.publishing.figures.learners import PICTURE
from experiments.publishing.markdown import markdown, paragraph

WORK_NOTE = (
    "The smallest gap in validation within so many samples, env steps and expert labels, and within so much training "
    f"time: the median over seeds, of validations with {percent(TARGET_SUCCESS, 0)} success, a dash where half of the "
    "seeds have none; the least are bold."
)
PACKAGES = ("flatgym", "stable-baselines3", "torch")
"""Packages whose versions are stated."""


def learners(results: Row) -> str:
    """Return the figure, the nominal table, the table under disturbances, and what their columns mean."""
    scores = summarise(results)
    nominal = [
        "task", "agent", "success", "gap to K*", "env steps", "expert labels", "training time [s]",
        f"samples to {percent(TARGET_GAP, 0)} gap",
    ]  # fmt: skip
    parts = [
        f"![Success, gap and learning curves of all agents](experiments/results/published/{PICTURE})",
        markdown(nominal, list(nominal_lines(results, scores))),
        paragraph(nominal_note(results, scores)),
        markdown(
            [
                "task",
                "agent",
                *(f"{limit:.0e} samples".replace("e+0", "e") for limit in SAMPLES),
                *(f"{s:.0f} s" for s in SECONDS),
            ],
            list(work_lines(results)),
        ),
        paragraph(WORK_NOTE),
        markdown(["task", "agent", *results["conditions"]], list(disturbed_lines(results, scores))),
        paragraph(disturbed_note(results, scores)),
        paragraph(study_provenance(results)),
    ]
    return "\n\n".join(parts)


def scores(results: Row) -> str:
    """Return the table of the quick benchmark, and its provenance."""
    found = summarise(results)
    times = {row["scenario"]: row["time_s"] for row in results["solutions"]}
    head = ["task", "T* [s]", "K*", "agent", "success", "gap to K*", "disturbed", "env steps", "training time [s]"]
    rows = [
        [
            f"`{problem}`",
            f"{times[problem]:.4f}" if problem in times else "varies",
            f"{results['k_star'][problem][0]:.0f}" if problem in times else "varies",
            shown_name(agent, cells_of(results, problem, agent)),
            format_success(found[problem, agent, NOMINAL]),
            format_gap(found[problem, agent, NOMINAL]),
            format_success(found[problem, agent, COMBINED]),
            format_count(mean(cells_of(results, problem, agent), "env_steps")),
            f"{mean(cells_of(results, problem, agent), 'training_s'):.0f}",
        ]
        for problem, agent in pairs(found)
    ]
    note = f"{provenance_sentence(results, PACKAGES)} Disturbed: success with wind, a mass error and a delay at once."
    if "note" in results:  # of whoever ran it, about the circumstances
        note += f" {results['note']}"
    if any(EARLIER in row for row in rows):
        note += " An earlier policy is one that is no longer shipped; the next run flies today's."
    return markdown(head, rows) + "\n\n" + paragraph(note)


def nominal_lines(results: Row, scores: Scores) -> Iterator[list[str]]:
    """Yield the lines of the nominal table."""
    for problem, agent in pairs(scores):
        cells = cells_of(results, problem, agent)
        score, trained = scores[problem, agent, NOMINAL], any(cell["curve"] for cell in cells)
        samples = [samples_to_target(cell, results["validation_k_star"][problem]) for cell in cells]
        yield [
            f"`{problem}`",
            display_name(agent),
            format_success(score),
            format_gap(score),
            format_count(mean(cells, "env_steps")),
            format_count(mean(cells, "expert_labels")),
            f"{mean(cells, 'training_s'):.0f}" if trained else "-",
            median_samples(samples) if trained else "-",
        ]


def work_lines(results: Row) -> Iterator[list[str]]:
    """Yield the lines of the gaps that learners reach within so many samples and seconds; the least are bold."""
    for problem in sorted(results["k_star"]):
        agents = dict.fromkeys(
            cell["agent"] for cell in results["cells"] if cell["problem"] == problem and cell.get("curve")
        )
        rows = {
            agent: gaps_by_work(cells_of(results, problem, agent), results["validation_k_star"][problem])
            for agent in sorted(agents, key=table_position)
        }
        least = [min(column) for column in zip(*rows.values(), strict=True)]
        for agent, gaps in rows.items():
            texts = [("-" if isinf(gap) else percent(gap, sign="+")) for gap in gaps]
            marked = [
                f"**{text}**" if gap == best < inf else text for text, gap, best in zip(texts, gaps, least, strict=True)
            ]
            yield [f"`{problem}`", display_name(agent), *marked]


def mean(cells: Sequence[Row], key: str) -> float:
    """Return the mean of a number over cells."""
    return float(np.mean([cell[key] for cell in cells]))


def disturbed_lines(results: Row, scores: Scores) -> Iterator[list[str]]:
    """Yield the lines of all conditions: success, and the gap of successful episodes."""
    for problem, agent in pairs(scores):
        rows = [scores[problem, agent, condition] for condition in results["conditions"]]
        cells = [f"{format_success(row)}, {format_gap(row, interval=False)}" for row in rows]
        yield [f"`{problem}`", display_name(agent), *cells]


def median_samples(samples: Sequence[float]) -> str:
    """Return the median over the runs that reach the targets, and their number if not all do."""
    reached = [count for count in samples if not np.isnan(count)]
    if not reached:
        return "never"
    return format_count(float(np.median(reached))) + (
        "" if len(reached) == len(samples) else f" ({len(reached)}/{len(samples)})"
    )


def nominal_note(results: Row, scores: Scores) -> str:
    """Return what the columns of the nominal table mean."""
    seeds = max(row["runs"] for row in scores.values())
    counts = {
        name: max(len(cell["episodes"][NOMINAL]["steps"]) for cell in results["cells"] if cell["problem"] == name)
        for name in results["k_star"]
    }
    episodes = ", ".join(f"{count:,} on `{name}`" for name, count in sorted(counts.items()))
    return (
        f"Means over {seeds} seeds of each learner, with 95 % bootstrap intervals over seeds and episodes in brackets. "
        f"Gaps are interquartile means over successes. Evaluation episodes per seed: {episodes}, unseen in training. "
        "Env steps are the policy's own, expert labels are steps labelled by an expert. Training time is on one core; "
        "it includes DAgger's expert labels, but not the demonstrations planned beforehand. Samples are env steps plus "
        f"expert labels until validation first reaches {percent(TARGET_SUCCESS, 0)} success with a mean gap of at most "
        f"{percent(TARGET_GAP, 0)}. {planning_note(results)}"
    ).strip()


def planning_note(results: Row) -> str:
    """Return how long the planning of the demonstrations took."""
    spent = {cell["problem"]: cell["planning_s"] for cell in results["cells"] if cell["agent"] in ("bc", "dagger")}
    if not spent:
        return ""
    times = " and ".join(f"{seconds:.1f} s on `{problem}`" for problem, seconds in sorted(spent.items()))
    return f"Planning the demonstrations took {times}, once for all agents, on all cores."


def disturbed_note(results: Row, scores: Scores) -> str:
    """Return how strong the disturbances are, and under which of them feedback is better than open-loop replay."""
    strengths = "; ".join(
        (f"{name}: " if len(active) > 1 else "") + describe_disturbances(active)
        for name, active in results["conditions"].items()
        if active
    )
    sentences = [
        "Success, and the gap of successful episodes to K* of the nominal vehicle. Disturbances are sampled once per "
        f"episode, the same for all agents: {strengths}. The expert is an LQR around a K* flight that is planned "
        "through narrower hoops; the expert without margin uses the hoops as they are. Open-loop replay applies the "
        "actions of the expert's flight without feedback."
    ]
    for problem in sorted(results["k_star"]):
        better = [name for name in results["conditions"] if feedback_is_better(scores, problem, name)]
        sentences.append(
            f"On `{problem}` the expert's feedback is better than open-loop replay under {join_names(better)}."
        )
    delayed = [
        row["success_rate"] for (_, agent, name), row in scores.items() if (agent, name) == ("open-loop", "delay")
    ]
    if delayed and min(delayed) == 1:
        sentences.append("A pure delay does not affect open-loop replay from rest; the flight is shifted by one step.")
    return " ".join(sentences)


def feedback_is_better(scores: Scores, problem: str, condition: str) -> bool:
    """Return whether the interval of the expert's success lies above that of open-loop replay."""
    expert, replay = (scores.get((problem, agent, condition)) for agent in ("expert", "open-loop"))
    return expert is not None and replay is not None and expert["success_low"] > replay["success_high"]


def study_provenance(results: Row) -> str:
    """Return the provenance of the comparison, and the command for a single agent."""
    command = "flatquad benchmark --study" + (" --quick" if results["smoke"] else "")
    dates = [results["date"], min(cell["date"] for cell in results["cells"])]
    sentence = provenance_sentence(results, PACKAGES, command=command, dates=dates)
    return f"{sentence} For a single agent add `--only hoop/dagger`."
