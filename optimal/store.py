"""Finished answers on disk, one file each, so that a broken-off batch goes on where it stopped.

A file is written whole under a temporary name and renamed, and named by a hash of the question: what
was asked, of which scenario, with which options. It holds plain JSON - the answer, the version that
gave it and a checksum - and nothing executable; numbers are written in full, so that reading gives
back the very same ones. A file that cannot be trusted is set aside, never overwritten.
"""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import flatgym
from flatgym.files import free, write_text
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps
from optimal.flights.certificate import Certificate
from optimal.flights.solution import Solution, Status
from optimal.flights.trajectory import Trajectory

Answer = Solution | FewestSteps
SCHEMA = 1
"""Version of the files; what another one wrote is set aside."""


class Store:
    """A folder of answers.

    Args:
        folder: made where it does not exist.
        question: what is asked of every scenario, with its options, as plain data.
    """

    def __init__(self, folder: str | Path, question: dict[str, Any]) -> None:
        self.folder, self.question = Path(folder), question
        self.folder.mkdir(parents=True, exist_ok=True)

    def path(self, scenario: Scenario) -> Path:
        """Return the file of a scenario's answer."""
        asked = json.dumps([self.question, scenario.to_dict()], sort_keys=True)
        word = re.sub(r"[^\w-]+", "_", scenario.name)[:40]
        return self.folder / f"{word}-{hashlib.sha256(asked.encode()).hexdigest()[:20]}.json"

    def read(self, scenario: Scenario) -> Answer | None:
        """Return a scenario's answer; None where there is none, or none to be trusted: that file is set aside."""
        path = self.path(scenario)
        try:
            return decoded(path.read_text(encoding="utf-8"), scenario)
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            aside = free(path.with_name(path.name + ".set-aside"))
            path.replace(aside)
            warnings.warn(
                f"{path} cannot be used ({error}); set aside as {aside.name} and computed again", stacklevel=2
            )
            return None

    def write(self, answer: Answer) -> None:
        """Keep an answer.

        Raises:
            OSError: naming the file, when it cannot be written; what was written before is kept.
        """
        path = self.path(answer.scenario)
        try:
            write_text(path, encoded(answer))
        except OSError as error:
            words = f"{error.strerror}; the answers finished before are kept: make room and run again"
            raise OSError(error.errno, words, str(path)) from error


def encoded(answer: Answer) -> str:
    """Return an answer as the text of its file.

    Raises:
        TypeError: for what has no plain form, as the flights of the flat road.
    """
    kind = type(answer).__name__
    values = {field.name: _plain(getattr(answer, field.name)) for field in fields(answer)}
    body = {"kind": kind, "answer": values}
    head = {"schema": SCHEMA, "version": flatgym.__version__, "sha256": _checksum(body)}
    return json.dumps(head | body, allow_nan=False) + "\n"


def decoded(text: str, scenario: Scenario) -> Answer:
    """Return the answer that a file's text holds.

    Raises:
        ValueError: when it is damaged, of another version, or answers for another scenario.
    """
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError("it holds no answer")
    found = data.get("schema"), data.get("version")
    if found != (SCHEMA, flatgym.__version__):
        raise ValueError(
            f"written as schema {found[0]} by version {found[1]}, wanted {SCHEMA} by {flatgym.__version__}"
        )
    body = {key: data[key] for key in ("kind", "answer")}
    if data.get("sha256") != _checksum(body):
        raise ValueError("its checksum is wrong")
    values = {name: _value(name, value, scenario) for name, value in body["answer"].items()}
    if values["scenario"] != scenario:
        raise ValueError(f"it answers for {values['scenario']}")
    return {"Solution": Solution, "FewestSteps": FewestSteps}[body["kind"]](**values)


def _checksum(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Return one field of an answer as JSON can hold it; numbers that are not finite become words."""
    if isinstance(value, Scenario):
        return value.to_dict()
    if isinstance(value, Certificate):
        return {name: _plain(number) for name, number in value.row().items()}
    if type(value) is Trajectory:
        return [_plain(array) for array in (value.breakpoints, value.states, value.controls)]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if isinstance(value, Status):
        return value.name
    if isinstance(value, float) and not np.isfinite(value):
        return {"number": repr(float(value))}
    if value is None or isinstance(value, (str, bool, int, float)):
        return value.item() if isinstance(value, np.generic) else value
    raise TypeError(f"a store keeps no {type(value).__name__}; leave out store=")


def _value(name: str, plain: Any, scenario: Scenario) -> Any:
    """Return one field of an answer for a scenario from its plain form."""
    if name == "scenario":
        return Scenario.from_dict(plain)
    if name == "status":
        return Status[plain]
    value = _finite_or_not(plain)
    if name == "certificate":
        return Certificate(**value)
    if name == "trajectory" and value is not None:
        breakpoints, states, controls = (np.array(array, dtype=np.float64) for array in value)
        return Trajectory(breakpoints, states, controls, scenario.quadrotor)
    if name in ("actions", "states"):
        width, kind = (2, np.float32) if name == "actions" else (5, np.float64)
        return np.array(value, dtype=kind).reshape(-1, width)
    return value


def _finite_or_not(plain: Any) -> Any:
    """Return plain data with the words for numbers that are not finite turned back into numbers."""
    if isinstance(plain, list):
        return [_finite_or_not(entry) for entry in plain]
    if isinstance(plain, dict):
        words = set(plain) == {"number"}
        return float(plain["number"]) if words else {key: _finite_or_not(entry) for key, entry in plain.items()}
    return plain
