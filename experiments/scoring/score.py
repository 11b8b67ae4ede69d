"""The score of a submission: its flights, K* of their scenarios, and the row.

    score(Submission(policy="my_module:policy", scenario="hoop"), store=None, timeout=60.0).row

The flights come first. K* of a task of one's own may take long or not be found, so it is computed afterwards, in
another process with a time limit, and only where a flight reached the goal: a score neither waits for it nor is lost
with it.
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.evaluation.optima import Optima, known_optima, optima
from agents.evaluation.protocol import seed_warning
from agents.evaluation.rollouts import fly
from agents.evaluation.scores import check_optima, flight_rows
from agents.policies import archive
from agents.policies.adapters import ZIP, innermost, statistics_of
from agents.policies.fingerprint import fingerprint
from experiments.files import Row
from experiments.provenance import provenance
from experiments.sandbox import Failed, run_isolated
from experiments.scoring import score_file
from experiments.scoring.submission import Submission
from flatgym.scenarios import catalogue
from flatgym.scenarios.disturbances import Disturbances

K_STAR_TIME = 60.0
"""Time limit for computing K* of a score [s]."""


@dataclass(frozen=True)
class Flown:
    """The flights of a policy.

    Attributes:
        outcomes: outcome of each, n words of OUTCOMES.
        actions: actions of each, n float32 arrays of shape (K, 2).
        columns: what the policy adds to the score row: algorithm, env_steps, wall_time_s.
        notes: sentences about the policy that its score does not show.
    """

    outcomes: tuple[str, ...]
    actions: tuple[NDArray[np.float32], ...]
    columns: Row
    notes: tuple[str, ...]

    @property
    def steps(self) -> NDArray[np.int64]:
        """Environment steps of each flight, shape (n,)."""
        return np.array([len(one) for one in self.actions])


@dataclass(frozen=True)
class Scored:
    """A score.

    Attributes:
        row: the score row, as of `agents.evaluate`, as JSON holds it.
        rows: one row for each flight.
        flown: the flights.
        notes: sentences about policy and K* that the row does not show.
    """

    row: Row
    rows: pd.DataFrame
    flown: Flown
    notes: tuple[str, ...]


def score(
    submission: Submission,
    store: Path | None,
    timeout: float,
    k_star_time: float = K_STAR_TIME,
    *,
    check: bool = True,
) -> Scored:
    """Return the score of a submission.

    Args:
        submission: the policy and the problem.
        store: folder of K* that have been computed.
        timeout: time limit for an external policy [s].
        k_star_time: time limit for computing unknown K* [s]; K* and gap stay NaN beyond it.
        check: raise an error for a flight without disturbances in fewer steps than K*.

    Raises:
        FasterThanOptimal: as `check` says.
        Failed: where an external policy fails, hangs or ends its process.
        ValueError: for a policy that may not be loaded or does not fit.
    """
    flown = fly_submission(submission, store, timeout)
    known, note = k_star(submission, flown, store, k_star_time)
    rows = flight_rows(flown, submission.problem, submission.seed, known=known)
    if check and not submission.disturbances.active:
        check_optima(flown.actions, rows, submission.problem)
    row = score_file.scored(rows, submission.seed, submission.disturbances, agent=submission.name, **flown.columns)
    return Scored(row, rows, flown, (*flown.notes, *filter(None, [note])))


def fly_submission(submission: Submission, store: Path | None, timeout: float) -> Flown:
    """Return the flights of a submission; arguments and errors as in `score`."""
    if submission.policy.endswith(ZIP):
        archive.admit(submission.policy, submission.trust)
    arguments = asdict(submission), str(store) if store else None
    found = (
        run_isolated("experiments.scoring.score:fly_fields", *arguments, seconds=timeout)
        if submission.policy
        else fly_fields(*arguments)
    )
    actions = tuple(map(score_file.decode, found["actions"]))
    return Flown(tuple(found["outcomes"]), actions, found["columns"], tuple(found["notes"]))


def fly_fields(fields: Row, store: str | None) -> Row:
    """Return the fields of Flown for the fields of a Submission; all as JSON holds them."""
    submission = Submission(**fields | {"disturbances": Disturbances(**fields["disturbances"])})
    task = submission.problem, submission.count, submission.seed, submission.disturbances
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        policy = submission.load(None if store is None else Path(store))
        began = time.perf_counter()
        flown = fly(policy, *task)
    said = [str(one.message) for one in caught if issubclass(one.category, UserWarning)]
    said.append(seed_warning(policy, task[0], task[2], task[1], task[3]))
    model = innermost(policy)
    columns = {
        "algorithm": type(model).__name__,
        "env_steps": getattr(model, "num_timesteps", None),
        "wall_time_s": round(time.perf_counter() - began, 2),
        "fingerprint": fingerprint_of(submission, statistics_of(policy)),
    }
    return {
        "outcomes": flown.outcomes,
        "actions": [score_file.encode(one) for one in flown.actions],
        "columns": columns,
        "notes": list(dict.fromkeys(filter(None, said))),
    }


def k_star(submission: Submission, flown: Flown, store: Path | None, seconds: float) -> tuple[Optima, str]:
    """Return K* of each flight, and a sentence if a K* that the score needs is missing; arguments as in `score`."""
    problem, seeds = submission.problem, submission.seed + np.arange(len(flown.outcomes))
    known = known_optima(problem, seeds, store)
    needed = np.flatnonzero(np.isnan(known.k_star) & (np.array(flown.outcomes) == "goal"))
    if needed.size and seconds > 0:
        arguments = catalogue.text(problem), seeds[needed].tolist(), str(store) if store else None
        try:
            found = run_isolated("experiments.scoring.score:find_k_star", *arguments, seconds=seconds)
        except Failed:
            known = known_optima(problem, seeds, store)  # some may have been found and stored
        else:
            known.k_star[needed], known.proven[needed] = np.array(found, dtype=np.float64)
    missing = int(np.isnan(known.k_star[needed]).sum())
    if not missing:
        return known, ""
    which = "K*" if missing == len(needed) else f"K* of {missing} of {len(needed)} flights"
    return known, f"{which} was not found within {seconds:g} s, and is left out of the gap; --k-star-time grants more"


def find_k_star(problem: str, seeds: list[int], store: str | None) -> list[list[float]]:
    """Return K* of seeds, and whether they are proven."""
    found = optima(problem, np.array(seeds), store)
    return [found.k_star.tolist(), found.proven.astype(float).tolist()]


def fingerprint_of(submission: Submission, statistics: Path | None) -> str | None:
    """Return the fingerprint of a submission's policy with its statistics, None for an object without a file."""
    try:
        return fingerprint(submission.source, statistics)
    except ValueError:
        return None


def record(submission: Submission, scored: Scored, path: Path, command: str) -> None:
    """Write a score file.

    Args:
        submission: the policy and the problem.
        scored: its score, also with flights in fewer steps than K*.
        path: the file.
        command: the command line, for the record.
    """
    policy = {"name": submission.name, "fingerprint": scored.row["fingerprint"]}
    problem = catalogue.problem(submission.problem)
    row, flights = scored.row | {"command": command}, score_file.flights(scored.rows, scored.flown.actions)
    score_file.write(path, problem, submission.disturbances, policy, row, flights, provenance(command))
    if not submission.disturbances.active and (scored.rows["gap"] < 0).any():
        faster = f"{submission.name} takes fewer steps than K*: K* is wrong; please report it with {path}"
        print(faster, file=sys.stderr)
