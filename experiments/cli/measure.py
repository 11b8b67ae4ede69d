"""`flatquad measure`: speed and correctness of the solvers, the environments and the demonstrations.

Sections that are run one at a time join the others in the results file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.cli.options import HELP_OPTIONS, Command, Jobs, Quick, ResultsFile
from experiments.files import ROOT, USER_RESULTS, check_output
from experiments.interrupts import keeping
from experiments.terminal import command_line, messages, progress_bar

if TYPE_CHECKING:
    from experiments.measurements.sections import Section

EXAMPLES = "Example: flatquad measure solvers speed warm; flatquad measure environments --quick"
Sections = Annotated[
    list[str] | None, typer.Argument(metavar="SECTION", help="Sections to run.", show_default="all sections")
]

app = typer.Typer(
    no_args_is_help=True, help="Measure speed and correctness of the package itself.", context_settings=HELP_OPTIONS
)


@app.command(cls=Command, epilog="Example: flatquad measure solvers speed warm")
def solvers(section: Sections = None, quick: Quick = False, out: ResultsFile = None) -> None:
    """Measure correctness, convergence, order and speed of the solvers and the proofs."""
    from experiments.measurements.solvers import SECTIONS

    write_sections(SECTIONS, section, quick, out or USER_RESULTS / "solvers.json")


@app.command(cls=Command, epilog="Example: flatquad measure environments batched scalar")
def environments(section: Sections = None, quick: Quick = False, out: ResultsFile = None) -> None:
    """Measure speed, start-up time and memory growth of the environments, relative to CartPole."""
    from experiments.measurements.environments import SECTIONS

    write_sections(SECTIONS, section, quick, out or USER_RESULTS / "envs.json")


@app.command(cls=Command, epilog="Example: flatquad measure demonstrations random-goal")
def demonstrations(section: Sections = None, quick: Quick = False, out: ResultsFile = None) -> None:
    """Measure how many demonstrations a second are recorded, and whether all replay to the goal."""
    from experiments.measurements.demonstrations import SECTIONS

    write_sections(SECTIONS, section, quick, out or USER_RESULTS / "demos.json")


@app.command(cls=Command, epilog="Example: flatquad measure reference")
def reference(
    out: ResultsFile = None,
    store: Annotated[Path, typer.Option(help="Folder of the finished sampled scenarios.")] = USER_RESULTS / "draws",
    jobs: Jobs = -1,
) -> None:
    """Recompute the best-known solutions that ship with flatgym; in a clone of the repository."""
    from experiments.measurements.reference_table import SAMPLED, write_table
    from flatgym.scenarios.reference import FILE

    path = check_output(out or ROOT / "flatgym" / "scenarios" / FILE, (".json",))
    with keeping(f"finished scenarios are kept in {store}; the same command continues"):
        write_table(path, sampled=SAMPLED, command=command_line(), store=store, jobs=jobs)
    messages.print(f"written: {path}", soft_wrap=True)


def write_sections(sections: Mapping[str, Section], names: list[str] | None, quick: bool, out: Path) -> None:
    """Run the named sections, or all, and write the results file."""
    from experiments.measurements.sections import chosen, measure

    wanted = chosen(sections, names or ())
    check_output(out, (".json",))
    with progress_bar(f"finished sections are kept in {out}; name the others to go on") as bar:
        measure(wanted, out, smoke=quick, command=command_line(), bar=bar)
    messages.print(f"{', '.join(wanted)} written to {out}", soft_wrap=True)
