"""Publish the latest results: `make readme` copies them and rebuilds README's tables and picture.

`experiments/results` holds your own runs and is not committed; `experiments/results/published` holds
the runs README speaks of. Between `<!-- NAME -->` and `<!-- /NAME -->` the README holds what `blocks`
returns; a test compares the two, so that a number typed by hand does not last.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from experiments.files import SCHEMA, write_text

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "experiments" / "results"
PUBLISHED = RESULTS / "published"
FILES = ("benchmark.json", "scores.csv", "paper.json")


def published(name: str) -> Any:
    """Return a published results file; a ValueError names one of another version."""
    path = PUBLISHED / name
    results = json.loads(path.read_text(encoding="utf-8"))
    if results.get("schema") != SCHEMA:
        raise ValueError(f"{path} has schema {results.get('schema')!r}, this version reads {SCHEMA}: run it again")
    return results


def blocks() -> dict[str, str]:
    """Return the generated parts of the README by name."""
    return {"scores": scores(published("benchmark.json")), "paper": judged(published("paper.json")["rows"])}


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown, all columns but the first aligned to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def scores(benchmark: dict[str, Any]) -> str:
    """Return the score table and how it came about."""
    times = {row["scenario"]: row["time_s"] for row in benchmark["solutions"]}
    rows = [
        [
            row["scenario"],
            f"{times[row['scenario']]:.4f}",
            str(row["k_star"]),
            row["algorithm"],
            f"{row['success_rate']:.0%}",
            "-" if row["steps"] is None else f"{row['steps']:g}",
            "-" if row["gap"] is None else f"{row['gap']:+.1%}",
            f"{row['env_steps'] / 1e6:.1f} M",
            f"{row['wall_time_s']:.0f}",
        ]
        for row in benchmark["scores"]
    ]
    head = ["scenario", "T* [s]", "K*", "agent", "success", "steps", "gap to K*", "env steps", "training [s]"]
    used = benchmark["versions"]
    note = (
        f"`{benchmark['command']}` on {benchmark['machine']['cores']} cores, {benchmark['date'][:10]}, seed "
        f"{benchmark['scores'][0]['seed']}; flatgym {used['flatgym']}, stable-baselines3 "
        f"{used['stable-baselines3']}, torch {used['torch']}."
    )
    return markdown(head, rows) + "\n\n" + note


def judged(rows: list[dict[str, Any]]) -> str:
    """Return the paper's times beside what can be flown."""

    def seconds(value: float | None, digits: int = 4) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    table = [
        [
            row["scenario"],
            "-" if row["printed_s"] is None else f"{row['printed_s']:g}",
            seconds(row["nodes_only_s"]),
            "-" if row["nodes_only_violation"] is None else f"{row['nodes_only_violation']:.0f}x",
            seconds(row["flat_certified_s"]),
            seconds(row["shooting_s"], 5),
            "-" if row["reference_8_s"] is None else f"{row['reference_8_s']:g}",
            seconds(row["lower_bound_s"]),
        ]
        for row in rows
    ]
    head = ["case", "printed", "nodes only", "its excess", "flat, certified", "T* (shooting)", "[8]", "bound"]
    return markdown(head, table)


def filled(text: str) -> str:
    """Return the README's text with its blocks replaced."""
    for name, block in blocks().items():
        pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        parts = pattern.split(text)
        if len(parts) != 4:
            raise ValueError(f"README.md must hold one block <!-- {name} --> ... <!-- /{name} -->")
        text = parts[0] + parts[1] + block + "\n" + parts[2] + parts[3]
    return text


def picture() -> None:
    """Draw the README's picture as SVG; needs the extra `figures` and a Chromium."""
    import optimal
    from experiments import figures
    from experiments.rl_vs_optimal import agent_track, optimal_track

    solution = optimal.solve("hoop")
    tracks = [optimal_track(solution), agent_track(published("benchmark.json"), solution.scenario)]
    chart = figures.paths(solution.scenario, tracks, "hoop: the optimum and an agent trained by PPO")
    write_text(PUBLISHED / "hoop-paths.svg", chart.to_image("svg", width=1000, height=540).decode())


def main() -> None:
    """Publish what new results there are, and bring README.md up to date."""
    for name in FILES:
        if (RESULTS / name).exists():
            write_text(PUBLISHED / name, (RESULTS / name).read_text(encoding="utf-8"))
    path = ROOT / "README.md"
    write_text(path, filled(path.read_text(encoding="utf-8")))
    picture()


if __name__ == "__main__":
    main()
