"""The command `flatquad`: a thin skin over the packages, a table or JSON for every answer.

Exit status: 0 done, 1 failed (no certified flight, say), 2 bad arguments.
"""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer
from rich.markup import escape

import flatgym
import optimal
from experiments.files import plain, read_json, write_json
from experiments.listing import distribution_row, scenario_row
from experiments.terminal import RESULTS, command_line, messages, progress_bar, screen, show, upright
from flatgym import catalogue
from flatgym.reference import EVALUATION_SEED, reference
from optimal.export import write_text

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="FlatQuad: how far from time-optimal is a learned quadrotor policy?",
    rich_markup_mode="rich",
)
Scenario = Annotated[str, typer.Argument(help="Name of a scenario; `flatquad list` shows them.", show_default=False)]
Problem = Annotated[
    str, typer.Argument(help="Name of a scenario or distribution; `flatquad list` shows them.", show_default=False)
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Jobs = Annotated[int, typer.Option(help="Worker processes; -1 is one for each core.")]
Backend = Annotated[str, typer.Option(help="loky: this machine, or ray: a Ray cluster.")]
Trust = Annotated[bool, typer.Option("--trust", help="Load zips: I know who wrote them.")]
Timeout = Annotated[float, typer.Option(min=1.0, help="How long the flights of a policy of yours may take [s].")]
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "flatquad"
"""Where K* that had to be computed are kept, for the next time."""


@app.command("list", epilog="Example: flatquad list --json")
def list_problems(as_json: AsJson = False) -> None:
    """List the named scenarios, with what is known of their optima, and the distributions of random ones."""
    scenarios = [scenario_row(scenario) for scenario in flatgym.SCENARIOS.values()]
    distributions = [distribution_row(distribution) for distribution in flatgym.DISTRIBUTIONS.values()]
    if as_json:
        # Whole numbers beside None stay whole as objects only.
        show(pd.DataFrame([*scenarios, *distributions], dtype=object), as_json)
        return
    titles = {
        "scenario": "scenario",
        "goal": "goal",
        "hoops": "hoops",
        "floor": "floor",
        "time_s": "T* [s]",
        "lower_bound_s": "bound",
        "k_star": "K*",
        "proven": "proven",
    }
    known = pd.DataFrame(scenarios)
    known["time_s"] = known["time_s"].round(5)
    known["lower_bound_s"] = np.floor(known["lower_bound_s"] * 1e5) / 1e5  # rounded upwards it would be none
    show(known[list(titles)].rename(columns=titles), as_json, "Scenarios")
    screen.print(
        "T*: the fastest flight known, exactly rest to rest; none is faster than the bound. K*: the fewest environment "
        "steps known, tolerance at the goal; proven if no flight takes fewer.\n",
        markup=False,
    )
    titles = {"scenario": "distribution", "goal": "goal, drawn for each episode", "hoops": "hoops"}
    show(pd.DataFrame(distributions)[list(titles)].rename(columns=titles), as_json, "Distributions")


@app.command(epilog="Example: flatquad solve hoop --out hoop.csv; flatquad solve horizontal-6 --method flat")
def solve(
    scenario: Scenario,
    method: Annotated[str, typer.Option(help="shooting, flat: the paper's eq. (10), or pontryagin.")] = "shooting",
    checks: Annotated[str, typer.Option(help="flat only: certified, or nodes as published.")] = "certified",
    steps: Annotated[bool, typer.Option("--steps", help="Also find K*, the fewest environment steps.")] = False,
    out: Annotated[Path | None, typer.Option(help="Write the flight to a .csv, .json or .npz file.")] = None,
    dt: Annotated[float, typer.Option(help="Time between the rows of that file [s].")] = 0.01,
    gap: Annotated[float, typer.Option(help="How close the proven lower bound is to come, relatively.")] = 1e-3,
    budget: Annotated[float, typer.Option(help="Time granted for each proof [s].")] = 10.0,
    as_json: AsJson = False,
) -> None:
    """Find the time-optimal flight of a scenario, certify it, and prove how much faster another could be."""
    with progress_bar() as bar:
        bar.add_task(f"solving {scenario}", total=None, note="")
        solution = optimal.solve(scenario, method=method, checks=checks, max_gap=gap, time_budget=budget)
        row = solution.row()
        if steps:
            fewest = optimal.fewest_steps(scenario, time_budget=budget)
            row |= {"k_star": fewest.steps, "k_lower_bound": fewest.lower_bound, "proven": fewest.proven}
    if out is not None:
        assert solution.trajectory is not None
        messages.print(f"flight: {optimal.save(solution.trajectory.sample(dt), out)}")
    show(pd.DataFrame([row]) if as_json else upright(row), as_json, solution.status.value)


@app.command(epilog="Example: flatquad paper --json")
def paper(
    out: Annotated[Path, typer.Option(help="File to write the rows to; the figures go beside it.")] = RESULTS
    / "paper.json",
    as_json: AsJson = False,
) -> None:
    """Compare the paper's printed times with what can be flown, judge which are impossible, and draw its figures."""
    from experiments import paper, paper_figures
    from experiments.provenance import provenance

    with progress_bar() as bar:
        work = bar.add_task("the paper's cases", total=len(paper.questions()), note="")
        tables = paper.tables(progress=lambda: bar.advance(work))
        record = plain({name: table.to_dict("records") for name, table in tables.items()})
        write_json(out, provenance(command_line()) | record)
        pages = paper_figures.pages(record["judged"])
        work = bar.add_task("the paper's figures", total=len(pages), note="")
        paper_figures.write(pages, out.parent, progress=lambda: bar.advance(work))
    messages.print(f"results and figures: {out.parent.resolve()}")
    if as_json:
        typer.echo(json.dumps(record, indent=1))
        return
    titles = {
        "scenario": "case",
        "printed_s": "printed",
        "nodes_only_s": "nodes only",
        "nodes_only_violation": "excess",
        "flat_certified_s": "flat",
        "shooting_s": "T*",
        "pontryagin_s": "Pontryagin",
        "reference_8_s": "[8]",
    }
    show(tables["rows"], as_json, "The paper's flights: printed, rebuilt, flown [s]", titles)
    screen.print(
        "nodes only: the published transcription, limits at grid nodes only; its excess is the largest violation "
        "between nodes, relative to the limit. flat, T*: the paper's method and shooting, within all limits at all "
        "times. Pontryagin: the method of [8], for flights in free space.\n",
        markup=False,
    )
    titles = {
        "road": "road",
        "cases": "cases",
        "iterations": "iterations",
        "cold_s": "cold",
        "warm_s": "warm",
        "starts": "starts",
        "converged": "converged",
        "succeeded": "found",
    }
    show(
        paper.by_road(tables["ease"]),
        as_json,
        "How easily: one solve from a plain start, and such starts on several grids",
        titles,
    )
    screen.print(
        "Medians over the cases [s]; cold: with the program yet to be built; warm: again. found: starts whose flight "
        f"keeps all limits at all times and is within {paper.SUCCESS:.1%} of the road's best.\n",
        markup=False,
    )
    show(paper.verdicts(tables["judged"]), as_json, "The paper judged: which printed times are impossible [s]")
    screen.print(
        "No flight within the paper's limits is faster than the proven bound; one takes the time flown, the gap above "
        "it. A printed time is impossible if it lies below the bound even with half a unit of its last digit added. "
        f"{paper.judgement(tables['judged'])}",
        markup=False,
    )


@app.command(epilog="Example: flatquad demos hoop -n 8; flatquad demos random-goal -n 1000 --export goals.csv")
def demos(
    scenario: Problem,
    number: Annotated[int, typer.Option("-n", "--number", min=1, help="How many flights from rest.")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    out: Annotated[str, typer.Option(help="Minari id of the dataset; by default named after the scenario.")] = "",
    displaced: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Greatest distance of a start from the scenario's own [m]; 0.5, or 0 for a distribution."
        ),
    ] = None,
    perturbed: Annotated[
        int, typer.Option(min=0, help="How often each flight is also knocked off on its way and planned anew.")
    ] = 0,
    budget: Annotated[float, typer.Option(min=0.0, help="Time granted for each proof [s].")] = 0.0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    export: Annotated[Path | None, typer.Option(help="Write the dataset to a .csv or .parquet file too.")] = None,
    as_json: AsJson = False,
) -> None:
    """Record fewest-steps flights as a Minari dataset.

    Flights that are found are kept beside Minari's datasets, so that a run broken off goes on where it stopped.
    """
    from agents import demonstrations
    from agents.exporting import check_export

    name, begun = demonstrations.dataset_id(scenario, out or None), time.perf_counter()
    if export is not None:
        check_export(export)
    with progress_bar() as bar:
        work = bar.add_task(f"demonstrations of {scenario}", total=number * (1 + perturbed), note="")

        found_before: list[int] = []  # flights of a run broken off

        def planned(done: int, of: int) -> None:
            if not found_before:
                found_before.append(done - 1)
            rate = (done - found_before[0]) / (time.perf_counter() - begun)
            bar.update(work, completed=done, total=of, note=f"{rate:.1f} flights/s")

        flights = demonstrations.plan(
            scenario,
            number,
            seed,
            spread=displaced,
            perturbed=perturbed,
            time_budget=budget,
            jobs=jobs,
            backend=backend,
            store=demonstrations.flights_folder(),
            progress=planned,
        )
        writing = bar.add_task(f"recorded as {name}", total=len(flights), note="")
        dataset = demonstrations.record(
            scenario, flights, name, progress=lambda done, _: bar.update(writing, completed=done)
        )
    row = {
        "dataset": dataset.id,
        "episodes": int(dataset.total_episodes),
        "steps": int(dataset.total_steps),
        "proven": sum(one.flight.proven for one in flights),
        "wall_time_s": time.perf_counter() - begun,
    }
    if export is not None:
        messages.print(f"table: {demonstrations.export(dataset, export)}", soft_wrap=True)
    show(pd.DataFrame([row]), as_json, "Recorded")


@app.command(
    epilog="Example: flatquad train hoop --seed 1 --folder runs/hoop-1; flatquad train random-goal --algorithm sac"
)
def train(
    scenario: Problem,
    algorithm: Annotated[str, typer.Option(help="ppo, sac, td3 or tqc.")] = "ppo",
    seed: Annotated[int, typer.Option(help="Seed of starts, network and exploration.")] = 0,
    seconds: Annotated[
        float | None, typer.Option(help="Wall time after which training stops [s].", show_default="the algorithm's")
    ] = None,
    env_steps: Annotated[
        int | None, typer.Option(help="Environment steps of the whole training.", show_default="the algorithm's")
    ] = None,
    policy: Annotated[
        str,
        typer.Option(
            help="Policy to start from: a pretrained one, or a zip; code in it is run, so name only your own."
        ),
    ] = "",
    folder: Annotated[
        Path | None, typer.Option(help="Where all is written.", show_default="runs/ALGORITHM-SCENARIO-SEED")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint in the folder.")] = False,
    as_json: AsJson = False,
) -> None:
    """Train a policy, and keep the best one met; interrupted, it goes on with --resume as if nothing had happened."""
    from agents.configs import config_of
    from agents.train import train

    wanted = {"seconds": seconds, "env_steps": env_steps}
    config = config_of(
        algorithm,
        scenario=scenario,
        seed=seed,
        policy=policy,
        folder=str(folder or Path("runs") / f"{algorithm.lower()}-{catalogue.problem(scenario).name}-{seed}"),
        **{name: value for name, value in wanted.items() if value is not None},
    )
    known = reference(config.scenario)
    with progress_bar() as bar:
        work = bar.add_task(f"{config.algorithm} on {scenario}", total=100, note="")

        def watch(point: dict[str, Any]) -> None:
            share = max(point["env_steps"] / config.env_steps, point["wall_time_s"] / config.seconds)
            note = f"success {point['success_rate']:.0%}, {point['steps']:.4g} steps"
            bar.update(work, completed=min(100, round(100 * share)), note=note)

        training = train(config, known.k_star if known else None, resume, watch)
    best = training.best
    row = {
        "scenario": scenario,
        "algorithm": config.algorithm,
        "seed": seed,
        "success_rate": best["success_rate"] if best else 0.0,
        "steps": best["steps"] if best else None,
        "k_star": known.k_star if known else None,
        "gap": known.gap(best["steps"]) if known and best else None,
        "env_steps": training.env_steps,
        "wall_time_s": round(training.wall_time_s, 1),
        "model": str(training.model),
    }
    show(pd.DataFrame([row], dtype=object) if as_json else upright(row), as_json, "Trained")


@app.command(
    epilog="Example: flatquad evaluate my_policy.zip --scenario hoop --trust --report mine.html; "
    "flatquad evaluate my_module:policy --scenario random-goal; flatquad evaluate --pretrained hoop"
)
def evaluate(
    policy: Annotated[
        str, typer.Argument(help="A policy's zip, whose code is run, so only with --trust; or module:object.")
    ] = "",
    scenario: Annotated[str, typer.Option(help="Name of a scenario or distribution; `flatquad list` shows them.")] = "",
    pretrained: Annotated[str, typer.Option(help="Name of a policy that came with the package.")] = "",
    agent: Annotated[str, typer.Option(help="expert: a flight in K* steps with feedback; or pd: a cascade.")] = "",
    episodes: Annotated[int, typer.Option(min=1, help="How many flights.")] = 100,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first flight; trainings use smaller ones.")
    ] = EVALUATION_SEED,
    trust: Trust = False,
    timeout: Timeout = 300.0,
    report: Annotated[
        Path | None, typer.Option(help="Also write a page with plots and a race, yours beside expert, PD and others.")
    ] = None,
    wind: Annotated[float, typer.Option(help="Greatest acceleration by the wind [m/s^2].")] = 0.0,
    mass: Annotated[float, typer.Option(help="Greatest error of the mass, as a share.")] = 0.0,
    thrust_gain: Annotated[float, typer.Option(help="Greatest error of the thrust, as a share.")] = 0.0,
    action_delay: Annotated[int, typer.Option(help="Greatest delay of the actions [steps].")] = 0,
    sensor_noise: Annotated[float, typer.Option(help="Standard deviation of what is measured [m, m/s, rad].")] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Score a policy, yours or one of ours: success, steps, and the gap to K*, the fewest steps possible.

    Yours is a zip of Stable-Baselines3, or anything with predict(observations) in a module. It flies in a process of
    its own, so that it may crash or hang.
    """
    from experiments import contest

    asked = contest.Contest(
        policy, pretrained, agent, scenario, trust, episodes, seed,
        flatgym.Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise),
    )  # fmt: skip
    with progress_bar() as bar:
        bar.add_task("flying", total=None, note="")
        rows = pd.DataFrame([contest.score(asked, CACHE, timeout) | {"command": command_line()}])
        if report is not None:
            page = contest.page(asked, report, command=command_line(), timeout=timeout, bar=bar)
    titles = {
        "scenario": "scenario",
        "agent": "agent",
        "episodes": "flights",
        "success_rate": "success",
        "steps": "steps",
        "k_star": "K*",
        "gap": "gap",
        "outcomes": "outcomes",
    }
    if not as_json:
        rows["outcomes"] = [", ".join(f"{word} {n}" for word, n in counts.items()) for counts in rows["outcomes"]]
    show(rows, as_json, "Score", titles)
    if report is not None:
        messages.print(f"report: {page.resolve()}", soft_wrap=True)


@app.command(
    epilog="Example: flatquad benchmark; flatquad benchmark --full --only hoop random-goal/ppo; "
    "flatquad benchmark --policy mine=my_policy.zip --trust"
)
def benchmark(
    full: Annotated[bool, typer.Option("--full", help="All scenarios, all agents, three seeds: hours.")] = False,
    only: Annotated[
        list[str] | None, typer.Option(help="PROBLEM or PROBLEM/AGENT; may be given several times.")
    ] = None,
    policy: Annotated[
        list[str] | None, typer.Option(help="NAME=ZIP or NAME=MODULE:OBJECT, an agent of yours; may be repeated.")
    ] = None,
    trust: Trust = False,
    timeout: Timeout = 300.0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    out: Annotated[Path, typer.Option(help="Folder for results, their cells, and the report.")] = RESULTS,
    as_json: AsJson = False,
) -> None:
    """Solve, demonstrate, train and score: how far from optimal are PPO and the others?

    Minutes, or hours with --full. Each finished cell is a file of its own, so a killed run goes on where it was. At the
    end stand a table, a JSON and a CSV file, and a page with plots and races.
    """
    from experiments import benchmark, contest, report
    from experiments.readme import published

    suite = benchmark.SUITES["full" if full else "quick"]
    suite = replace(suite, policies=contest.named(policy or (), trust), timeout=timeout)
    folder = out / ("benchmark-full" if full else "benchmark")
    with progress_bar() as bar:
        results = benchmark.run(
            suite, folder, command=command_line(), bar=bar, only=only or (), jobs=jobs, backend=backend
        )
        work = bar.add_task("report", total=1, note="")
        table = benchmark.scores(results)
        write_text(out / f"{folder.name}.csv", table.to_csv(index=False))
        page = report.write(out / "report.html", results, published("paper.json"))
        bar.advance(work)
    titles = {
        "problem": "on",
        "agent": "agent",
        "success_rate": "success",
        "gap": "gap",
        "gap_low": "from",
        "gap_high": "to",
        "learning_s": "learning [s]",
        "error": "error",
    }
    seen = table if as_json else table[table["condition"] == "calm"]
    show(seen, as_json, "Scores, undisturbed: gap to K*, with its 95 % interval", titles)
    messages.print(f"results: {out.resolve()}\nreport: {page.resolve()}", soft_wrap=True)
    if any(cell.get("error") for cell in results["cells"]):
        raise typer.Exit(1)


@app.command(epilog="Example: flatquad report --out report.html")
def report(
    results: Annotated[
        Path | None, typer.Option(help="A benchmark's JSON; by default your newest, else the published ones.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The page to write.")] = RESULTS / "report.html",
    as_json: AsJson = False,
) -> None:
    """Write one page of all results: leaderboard, gaps, learning curves, the paper's figures, and a ghost race."""
    from experiments import benchmark, report
    from experiments.readme import published

    if results is not None and not results.exists():
        raise ValueError(f"there is no {results}; `flatquad benchmark` writes one")
    own = [results] if results else sorted(RESULTS.glob("benchmark*.json"), key=lambda path: -path.stat().st_mtime)
    found = [data for path in own[:1] if (data := read_json(path)) is not None]
    if results is not None and not found:
        raise ValueError(f"{results} holds no results that can be read")
    with progress_bar() as bar:
        bar.add_task("report", total=None, note="")
        shown = benchmark.merged(
            *found, *(() if results else (published("benchmark.json"), published("learners.json")))
        )
        page = report.write(out, shown, published("paper.json"))
    if as_json:
        typer.echo(json.dumps({"report": str(page.resolve()), "bytes": page.stat().st_size}))
    else:
        messages.print(f"report: {page.resolve()}", soft_wrap=True)


@app.command(epilog="Example: flatquad play hoop --speed 0.25; flatquad play slalom --video slalom.mp4")
def play(
    scenario: Annotated[
        str, typer.Argument(help="Name of a scenario or distribution; `flatquad list` shows them.")
    ] = "hoop",
    speed: Annotated[float, typer.Option(help="How fast time passes; 1 is real time, and too fast for most.")] = 0.25,
    ghost: Annotated[bool, typer.Option(help="Fly against the best flight known.")] = True,
    video: Annotated[Path | None, typer.Option(help="Write what is seen to an .mp4 or .gif file.")] = None,
) -> None:
    """Fly it yourself, with arrow keys or a gamepad, against the ghost of the best flight known.

    Left and right turn, up and down are full and least thrust; with nothing held it hovers.
    R flies again, space pauses, G hides the ghost, [ and ] change the speed, Q quits.
    """
    from experiments import play

    session = play.play(scenario, speed, ghost, video)
    if session.best_steps:
        messages.print(f"best flight: {session.best_steps} steps")
    if video is not None:
        messages.print(f"video: {video.resolve()}", soft_wrap=True)


def main() -> None:
    """Run the command; turn what went wrong into a sentence and an exit status."""
    try:
        app()
    except ValueError as error:
        messages.print(f"[bold red]error:[/] {escape(str(error))}", highlight=False)
        sys.exit(2)
    except (optimal.SolveFailed, ImportError, OSError) as error:
        messages.print(f"[bold red]failed:[/] {escape(str(error))}", highlight=False)
        sys.exit(1)


if __name__ == "__main__":
    main()
