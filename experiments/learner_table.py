"""What the README says of learning: the study's tables and picture, the pretrained policies, the demonstrations.

    scores        benchmark.json            the quick benchmark
    learners      learners.json             agents side by side, undisturbed and disturbed
    pretrained    agents/pretrained/*.json  the policies that come with the package
    demos         demos.json                how fast demonstrations are made, and whether all replay

Success and gap stand with bootstrap intervals over seeds and flights (`agents.intervals`). The gap of a disturbed
flight is to K* of the undisturbed vehicle, so with a tail wind it may be negative.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from agents.intervals import summary
from experiments.figures import COLOURS, FLAME, INK, OUTLINE, layout
from experiments.tables import markdown
from optimal.export import write_text

Row = dict[str, Any]
Scores = dict[tuple[str, str, str], Row]
"""What flights add up to, by scenario, agent and condition."""
NAMES = {
    "ppo": "PPO",
    "sac": "SAC",
    "bc": "BC",
    "dagger": "DAgger",
    "bc-ppo": "BC, then PPO",
    "expert": "expert",
    "replanner": "expert, planning anew",
    "expert-rim": "expert along the rim",
    "tape": "tape of the expert",
    "pd": "cascaded PD",
    "pretrained": "pretrained",
}
"""What agents are called, in the order of the tables."""
PAINT = dict(zip(NAMES, (*COLOURS, FLAME), strict=False))
"""Colours of what is learnt; the others are grey."""
RELIABLE, NEAR = 0.9, 0.1
"""Success and mean gap of a check from which an agent counts as having learnt."""
LATE = ("tape", "delay")
PICTURE = "learners.svg"
WIDTH = 118


def flights(results: Row) -> pd.DataFrame:
    """Return one row a flight: scenario, agent, run, condition, outcome, steps, gap; steps and gap NaN where failed."""
    parts = []
    for cell in results["cells"]:
        for condition, flown in cell["flights"].items():
            steps = np.array(flown["steps"], dtype=np.float64)
            k_star = np.array(results["k_star"][cell["problem"]], dtype=np.float64)[: len(steps)]
            shared = {"scenario": cell["problem"], "agent": cell["agent"], "run": cell["seed"], "condition": condition}
            outcome = np.where(np.isnan(steps), "failed", "goal")
            parts.append(pd.DataFrame(shared | {"outcome": outcome, "steps": steps, "gap": steps / k_star - 1}))
    return pd.concat(parts, ignore_index=True)


def scored(results: Row) -> Scores:
    """Return the summary of each scenario, agent and condition, in the order of NAMES."""
    table = summary(flights(results), ("scenario", "agent", "condition")).to_dict("records")
    table.sort(key=lambda row: place(row["agent"]))
    return {(row["scenario"], row["agent"], row["condition"]): row for row in table}


def called(agent: str) -> str:
    """Return what an agent is called: the name in NAMES, or its own where it is not of the study."""
    return NAMES.get(agent, agent)


def place(agent: str) -> int:
    """Return an agent's place in the tables: the order of NAMES, others behind."""
    return list(NAMES).index(agent) if agent in NAMES else len(NAMES)


def learnt_after(cell: Row, k_check: float) -> float:
    """Return the environment steps, flown and shown, after which a check was reliable and near K*; NaN if none was."""
    for point in cell["curve"]:
        if point["success_rate"] >= RELIABLE and point["steps"] / k_check - 1 <= NEAR:
            return float(point["env_steps"] + point["expert_steps"])
    return float("nan")


def learners(results: Row) -> str:
    """Return the picture, the agents side by side, the same under disturbances, and how all came about."""
    found = scored(results)
    calm = ["on", "agent", "success", "gap to K*", "steps flown", "steps shown", "learning [s]", "learnt after"]
    rough = ["on", "agent", *results["conditions"]]
    parts = [
        f"![Success, gap and learning curves of all agents](experiments/results/published/{PICTURE})",
        markdown(calm, list(side_by_side(results, found))),
        fill(explained(results, found), WIDTH, break_on_hyphens=False),
        markdown(rough, list(disturbed(results, found))),
        fill(robustness(results, found), WIDTH, break_on_hyphens=False),
        fill(told(results), WIDTH, break_on_hyphens=False),
    ]
    return "\n\n".join(parts)


def scores(results: Row) -> str:
    """Return the table of the quick benchmark: everybody undisturbed and disturbed, and how it came about."""
    found = scored(results)
    times = {row["scenario"]: row["time_s"] for row in results["solutions"]}
    head = ["on", "T* [s]", "K*", "agent", "success", "gap to K*", "disturbed", "steps flown", "learning [s]"]
    rows = [
        [
            f"`{problem}`",
            f"{times[problem]:.4f}" if problem in times else "each its own",
            f"{results['k_star'][problem][0]:.0f}" if problem in times else "each its own",
            called(agent),
            share(found[problem, agent, "calm"]),
            gap(found[problem, agent, "calm"]),
            share(found[problem, agent, "together"]),
            amount(np.mean([cell["env_steps"] for cell in runs_of(results, problem, agent)])),
            f"{np.mean([cell['wall_time_s'] for cell in runs_of(results, problem, agent)]):.0f}",
        ]
        for problem, agent in pairs(found)
    ]
    used = results["versions"]
    note = (
        f"`{results['command']}` on {results['machine']['cores']} cores ({results['processor']}), "
        f"{results['date'][:10]}; flatgym {used['flatgym']}, stable-baselines3 {used['stable-baselines3']}, torch "
        f"{used['torch']}. Disturbed: success in wind, with another mass and a delay at once."
    )
    return markdown(head, rows) + "\n\n" + fill(note, WIDTH, break_on_hyphens=False)


def side_by_side(results: Row, found: Scores) -> Iterator[list[str]]:
    """Yield the lines of the undisturbed flights."""
    for problem, agent in pairs(found):
        runs = runs_of(results, problem, agent)
        row, learnt = found[problem, agent, "calm"], any(cell["curve"] for cell in runs)
        yield [
            f"`{problem}`",
            called(agent),
            share(row),
            gap(row),
            amount(np.mean([cell["env_steps"] for cell in runs])),
            amount(np.mean([cell["expert_steps"] for cell in runs])),
            f"{np.mean([cell['wall_time_s'] for cell in runs]):.0f}" if learnt else "-",
            efficiency([learnt_after(cell, results["k_check"][problem]) for cell in runs]) if learnt else "-",
        ]


def disturbed(results: Row, found: Scores) -> Iterator[list[str]]:
    """Yield the lines of all conditions: success, and the gap of what succeeded."""
    for problem, agent in pairs(found):
        cells = [found[problem, agent, condition] for condition in results["conditions"]]
        yield [f"`{problem}`", called(agent), *(f"{share(row)}, {gap(row, bounds=False)}" for row in cells)]


def pairs(found: Scores) -> list[tuple[str, str]]:
    """Return problems and agents, one problem after the other, the agents in the order of NAMES."""
    problems = sorted({problem for problem, _, _ in found})
    known = dict.fromkeys((problem, agent) for problem, agent, _ in found)
    return [pair for problem in problems for pair in known if pair[0] == problem]


def runs_of(results: Row, problem: str, agent: str) -> list[Row]:
    """Return the cells of an agent."""
    return [cell for cell in results["cells"] if (cell["problem"], cell["agent"]) == (problem, agent)]


def share(row: Row) -> str:
    """Return a success rate with its interval, which is left out where it is a point."""
    low, high = row["success_low"], row["success_high"]
    within = "" if low == high else f" [{100 * low:.0f}, {100 * high:.0f}]"
    return f"{rounded(row['success_rate'])}{within}"


def rounded(rate: float) -> str:
    """Return a success rate in per cent, which is 100 or 0 only where it is."""
    percent = f"{100 * rate:.0f} %"
    return percent if rate in (0, 1) or percent not in ("100 %", "0 %") else f"{100 * rate:.1f} %"


def gap(row: Row, bounds: bool = True) -> str:
    """Return a gap with its interval; a dash where nothing succeeded."""
    if np.isnan(row["gap"]):
        return "-"
    low, high = row["gap_low"], row["gap_high"]
    within = "" if low == high or not bounds else f" [{100 * low:.1f}, {100 * high:.1f}]"
    return f"{100 * row['gap']:+.1f} %{within}"


def amount(count: float) -> str:
    """Return a number of steps in thousands or millions; a dash for none."""
    if not count:
        return "-"
    return f"{count / 1e6:.2f} M" if count >= 1e6 else f"{count / 1e3:.1f} k"


def efficiency(after: Sequence[float]) -> str:
    """Return the median over the runs that learnt, and how many did where not all."""
    reached = [steps for steps in after if not np.isnan(steps)]
    if not reached:
        return "never"
    return amount(float(np.median(reached))) + ("" if len(reached) == len(after) else f" ({len(reached)}/{len(after)})")


def explained(results: Row, found: Scores) -> str:
    """Return what the columns of the first table mean."""
    seeds = max(row["runs"] for row in found.values())
    drawn = {name: max(len(cell["flights"]["calm"]["steps"]) for cell in results["cells"] if cell["problem"] == name)
             for name in results["k_star"]}  # fmt: skip
    goals = ", ".join(f"{count:,} on `{name}`" for name, count in sorted(drawn.items()))
    return (
        f"Means over {seeds} seeds of each learner; in brackets 95 % bootstrap intervals over seeds and flights; gaps "
        f"are interquartile means over successes. Scored flights a seed: {goals}, none met in training. Steps flown "
        "are the learner's own in the environment, steps shown those for which an expert said what to do. Learning is "
        "timed on one core, DAgger's advice included, plans made beforehand not. Learnt after so many steps, both: "
        f"when a check first succeeded in {100 * RELIABLE:.0f} % of its flights with a mean gap of at most "
        f"{100 * NEAR:.0f} %. "
        f"{planning(results)}"
    )


def planning(results: Row) -> str:
    """Return how long the planning of the demonstrations took."""
    spent = {cell["problem"]: cell["planning_s"] for cell in results["cells"] if cell["agent"] in ("bc", "dagger")}
    if not spent:
        return ""
    words = " and ".join(f"{seconds:.1f} s on `{problem}`" for problem, seconds in sorted(spent.items()))
    return f"Planning what is imitated took {words}, once for all, on all cores."


def robustness(results: Row, found: Scores) -> str:
    """Return how strong the disturbances are, and under which of them feedback beats replay."""
    strengths = "; ".join(
        (f"{name}: " if len(active) > 1 else "") + strength(active)
        for name, active in results["conditions"].items()
        if active
    )
    words = [
        "Success, and the gap of what succeeds to K* of the undisturbed vehicle. Drawn once a flight, the same for "
        f"all - {strengths}. The expert flies a K* flight planned through a narrower hoop, the one along the rim does "
        "not; the tape is the actions of the expert's flight as they stand."
    ]
    for problem in sorted(results["k_star"]):
        better = [name for name in results["conditions"] if beaten(found, problem, name)]
        words.append(f"On `{problem}` the expert's feedback beats its tape under {listed(better)}.")
    tapes = [row["success_rate"] for (_, agent, condition), row in found.items() if (agent, condition) == LATE]
    if tapes and min(tapes) == 1:
        words.append("A delay alone does nothing to a tape that begins at rest: it is the same flight, a step later.")
    return " ".join(words)


def strength(active: dict[str, float]) -> str:
    """Return how strong disturbances may be, in words."""
    words = {
        "wind": lambda value: f"wind up to {value:g} m/s²",
        "mass": lambda value: f"mass within {100 * value:g} %",
        "action_delay": lambda value: f"actions up to {value:g} step late",
    }
    return ", ".join(words[name](value) if name in words else f"{name} {value:g}" for name, value in active.items())


def beaten(found: Scores, problem: str, condition: str) -> bool:
    """Return whether the interval of the expert's success lies above that of its tape's."""
    rows = [found.get((problem, agent, condition)) for agent in ("expert", "tape")]
    return rows[0] is not None and rows[1] is not None and rows[0]["success_low"] > rows[1]["success_high"]


def listed(names: Sequence[str]) -> str:
    """Return names as one says them."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names) or "none"


def told(results: Row) -> str:
    """Return command, machine, dates and versions."""
    machine, used = results["machine"], results["versions"]
    dates = " to ".join(sorted({min(c["date"] for c in results["cells"])[:10], results["date"][:10]}))
    small = " Small sizes, only to see that it runs: the numbers mean nothing." if results["quick"] else ""
    return (
        f"`python -m experiments.learners{' --quick' if results['quick'] else ''}` on {machine['cores']} cores "
        f"({machine['processor']}, {machine['system']}), {dates}; one line alone: `--only hoop/dagger`. flatgym "
        f"{used['flatgym']}, stable-baselines3 {used['stable-baselines3']}, torch {used['torch']}.{small}"
    )


def pretrained(folder: Path) -> str:
    """Return the table of the policies in a folder, from the cards beside them."""
    cards = [(path.stem, json.loads(path.read_text(encoding="utf-8"))) for path in sorted(folder.glob("*.json"))]
    head = ["policy", "made by", "success", "steps", "K*", "gap", "steps flown", "training [s]", "size [kB]"]
    rows = [[f"`{name}`", *carded(card), kilobytes(folder / f"{name}.zip")] for name, card in cards]
    commands = [f"- `{name}`: `{card['command']}`" for name, card in cards]
    return "\n\n".join([markdown(head, rows), "The commands that made them:", "\n".join(commands)])


def carded(card: Row) -> list[str]:
    """Return what the score in a card says."""
    score = card["score"]
    return [
        score["algorithm"],
        rounded(score["success_rate"]),
        "-" if score["steps"] is None else f"{score['steps']:.4g}",
        f"{score['k_star']:.4g}",
        "-" if score["gap"] is None else f"{100 * score['gap']:+.1f} %",
        amount(score["env_steps"] or 0),
        f"{score['wall_time_s']:.0f}",
    ]


def kilobytes(path: Path) -> str:
    """Return the size of a file in units of 1,000 bytes."""
    return f"{path.stat().st_size / 1e3:.0f}"


def demos(results: Row) -> str:
    """Return how fast demonstrations are made, and how many replay to the goal in as many steps."""
    head = ["section", "flights", "flights a second", "K* proven", "mean steps", "replayed to goal", "kB a flight"]
    rows = [
        [
            f"{name}, `{row['what']}`" if name != row["what"] else f"`{name}`",
            f"{row['flights']:,}",
            f"{row['per_second']:.1f}",
            rounded(row["proven"]),
            f"{row['mean_steps']:.1f}",
            rounded(row["replayed_to_goal"]),
            f"{row['bytes_per_flight'] / 1e3:.1f}",
        ]
        for name, section in results["sections"].items()
        for row in section["rows"]
    ]
    processes = max(row["processes"] for section in results["sections"].values() for row in section["rows"])
    dates = " and ".join(sorted({section["date"][:10] for section in results["sections"].values()}))
    note = (
        f"`python -m experiments.demo_benchmark` with {processes} processes, {dates}: from the order to the dataset on "
        "disk. Flights are proven only where that is asked for, by a time budget."
    )
    return markdown(head, rows) + "\n\n" + fill(note, WIDTH, break_on_hyphens=False)


def picture(results: Row) -> go.Figure:
    """Return success and gap of all agents, and how near K* the learners had come after so many steps."""
    found = scored(results)
    problems = sorted(results["k_star"])
    titles = [f"{name}: {what}" for name in problems for what in ("success", "gap to K*", "gap while learning")]
    figure = make_subplots(
        rows=len(problems), cols=3, subplot_titles=titles, horizontal_spacing=0.06, vertical_spacing=0.16,
        column_widths=[0.27, 0.27, 0.46],
    )  # fmt: skip
    for row, problem in enumerate(problems, start=1):
        agents = [agent for name, agent in pairs(found) if name == problem]
        bars(figure, [found[problem, agent, "calm"] for agent in agents], row)
        together = [found[problem, agent, "together"] for agent in agents]
        marks(figure, together, row)
        gaps(figure, [found[problem, agent, "calm"] for agent in agents], row)
        for agent in agents:
            for number, cell in enumerate(runs_of(results, problem, agent)):
                curve(figure, cell, results["k_check"][problem], row, legend=row == 1 and number == 0)
        for column in (1, 2):
            figure.update_yaxes(
                categoryorder="array", categoryarray=[called(agent) for agent in reversed(agents)],
                showticklabels=column == 1, ticklabelstandoff=8, dtick=1, row=row, col=column,
            )  # fmt: skip
        figure.update_xaxes(range=[0, 1.04], tickformat=".0%", tickvals=[0, 0.5, 1], row=row, col=1)
        figure.update_xaxes(tickformat=".0%", rangemode="tozero", row=row, col=2)
        figure.update_yaxes(tickformat=".0%", range=[-0.01, 0.4], side="right", row=row, col=3)
        figure.update_xaxes(type="log", exponentformat="SI", dtick=1, row=row, col=3)
    for column, text in enumerate(
        ("diamonds: disturbed", "undisturbed", "environment steps, flown and shown"), start=1
    ):
        figure.update_xaxes(title={"text": text, "font": {"size": 13}}, row=len(problems), col=column)
    figure.update_traces(cliponaxis=False, col=1)
    figure.update_traces(cliponaxis=False, col=2)
    figure.update_annotations(font_size=13)
    return layout(figure, "How near the optimum agents fly").update_layout(
        width=1100,
        height=160 + 260 * len(problems),
        bargap=0.35,
        margin={"l": 160, "r": 50, "t": 110, "b": 50},
        legend={"y": 1 + 30 / (260 * len(problems))},
    )


def colour(agent: str) -> str:
    """Return the colour of an agent."""
    return PAINT.get(agent, OUTLINE)


def error(rows: Sequence[Row], name: str, middle: str) -> dict[str, Any]:
    """Return the whiskers of an interval."""
    return {
        "type": "data",
        "symmetric": False,
        "array": [row[f"{name}_high"] - row[middle] for row in rows],
        "arrayminus": [row[middle] - row[f"{name}_low"] for row in rows],
        "color": INK,
        "thickness": 1.2,
        "width": 3,
    }


def bars(figure: go.Figure, rows: Sequence[Row], row: int) -> None:
    """Draw the success of undisturbed flights."""
    figure.add_bar(
        x=[one["success_rate"] for one in rows], y=[called(one["agent"]) for one in rows], orientation="h",
        marker={"color": [colour(one["agent"]) for one in rows]}, error_x=error(rows, "success", "success_rate"),
        showlegend=False, row=row, col=1,
    )  # fmt: skip


def marks(figure: go.Figure, rows: Sequence[Row], row: int) -> None:
    """Draw the success of disturbed flights."""
    figure.add_scatter(
        x=[one["success_rate"] for one in rows], y=[called(one["agent"]) for one in rows], mode="markers",
        marker={"symbol": "diamond", "size": 9, "color": "white", "line": {"color": INK, "width": 1.5}},
        error_x=error(rows, "success", "success_rate"), showlegend=False, row=row, col=1,
    )  # fmt: skip


def gaps(figure: go.Figure, rows: Sequence[Row], row: int) -> None:
    """Draw the gaps with their intervals."""
    figure.add_scatter(
        x=[one["gap"] for one in rows], y=[called(one["agent"]) for one in rows], mode="markers",
        marker={"size": 9, "color": [colour(one["agent"]) for one in rows]}, error_x=error(rows, "gap", "gap"),
        showlegend=False, row=row, col=2,
    )  # fmt: skip


def curve(figure: go.Figure, cell: Row, k_check: float, row: int, legend: bool) -> None:
    """Draw the least gap so far of the checks that were reliable."""
    if not cell["curve"]:
        return
    steps, least = approach(cell, k_check)
    figure.add_scatter(
        x=steps, y=least,
        mode="lines+markers", line={"color": colour(cell["agent"]), "width": 1.5, "shape": "hv"}, marker={"size": 5},
        name=called(cell["agent"]), legendgroup=cell["agent"], showlegend=legend, row=row, col=3,
    )  # fmt: skip


def approach(cell: Row, k_check: float) -> tuple[list[float], list[float]]:
    """Return the environment steps, flown and shown, of the reliable checks, and the least gap to K* until each."""
    good = [point for point in cell["curve"] if point["success_rate"] >= RELIABLE]
    steps = [float(point["env_steps"] + point["expert_steps"]) for point in good]
    gaps = [float(point["steps"] / k_check - 1) for point in good]
    return steps, list(accumulate(gaps, min))


def draw(folder: Path, results: Row) -> None:
    """Draw the picture as SVG; needs the extra `figures` and a Chromium."""
    write_text(folder / PICTURE, picture(results).to_image("svg").decode())
