"""What the README says of learning: the study's tables and picture, the pretrained policies, the demonstrations.

    scores        benchmark.json            the quick benchmark
    learners      learners.json             agents side by side, undisturbed and disturbed
    pretrained    agents/pretrained/*.json  the policies that come with the package
    demos         demos.json                how fast demonstrations are made, and whether all replay

Success and gap stand with bootstrap intervals over seeds and flights (`agents.evaluation.bootstrap`). The gap of a disturbed
flight is to K* of the undisturbed vehicle, so with a tail wind it may be negative.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from textwrap import fill

import numpy as np

from experiments.benchmark.agents import called
from experiments.benchmark.formats import amount, gap, listed, share, strength
from experiments.benchmark.summary import NEAR, RELIABLE, Scores, learnt_after, pairs, runs_of, scored
from experiments.files import Row
from experiments.publishing.learner_figure import PICTURE
from experiments.publishing.markdown import markdown

LATE = ("tape", "delay")
WIDTH = 118


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


def beaten(found: Scores, problem: str, condition: str) -> bool:
    """Return whether the interval of the expert's success lies above that of its tape's."""
    rows = [found.get((problem, agent, condition)) for agent in ("expert", "tape")]
    return rows[0] is not None and rows[1] is not None and rows[0]["success_low"] > rows[1]["success_high"]


def told(results: Row) -> str:
    """Return command, machine, dates and versions."""
    machine, used = results["machine"], results["versions"]
    dates = " to ".join(sorted({min(c["date"] for c in results["cells"])[:10], results["date"][:10]}))
    small = " Small sizes, only to see that it runs: the numbers mean nothing." if results["quick"] else ""
    return (
        f"`python -m experiments.benchmark.study{' --quick' if results['quick'] else ''}` on {machine['cores']} cores "
        f"({machine['processor']}, {machine['system']}), {dates}; one line alone: `--only hoop/dagger`. flatgym "
        f"{used['flatgym']}, stable-baselines3 {used['stable-baselines3']}, torch {used['torch']}.{small}"
    )
