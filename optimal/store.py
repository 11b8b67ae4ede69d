"""Finished answers on disk, one file each; an interrupted batch resumes from them.

A file is named by the digest of the scenario's content, and by a hash of the solver and its options. So a scenario has
the same answers under any name. A file is written under a temporary name and then renamed. It holds plain JSON and
nothing executable: the answer, the version that computed it, and a checksum. Numbers are written in full; reading
returns the same numbers to the bit. A damaged file is moved aside, never overwritten.

JSON has no infinities and no NaN. Here they are written as {"number": "inf"}, because an answer must read back to the
same values. Result files for people and programs (`experiments.files.plain`) have null instead.
"""

from __future__ import annotations

import hashlib
import json
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
"""Version of the file format; files of another version are moved aside."""


class Store:
    """A folder of answers.

    Args:
        folder: created if it does not exist.
        question: the solver and its options, the same for every scenario, as plain data.
    """

    def __init__(self, folder: str | Path, question: dict[str, Any]) -> None:
        self.folder, self.question = Path(folder), question
        self.folder.mkdir(parents=True, exist_ok=True)

    def path(self, scenario: Scenario) -> Path:
        """Return the file of a scenario's answer."""
        question = hashlib.sha256(json.dumps(self.question, sort_keys=True).encode()).hexdigest()
        return self.folder / f"{scenario.digest[:20]}-{question[:12]}.json"

    def read(self, scenario: Scenario) -> Answer | None:
        """Return a scenario's answer; None if there is no file, or if the file is damaged, which moves it aside."""
        path = self.path(scenario)
        try:
            return decoded(path.read_text(encoding="utf-8"), scenario)
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            aside = free(path.with_name(path.name + ".set-aside"))
            path.replace(aside)
            warnings.warn(
                f"{path} cannot be used ({error}); moved aside as {aside.name} and computed again", stacklevel=2
            )
            return None

    def write(self, answer: Answer) -> None:
        """Write an answer.

        Raises:
            OSError: naming the file, when it cannot be written; earlier answers stay.
        """
        path = self.path(answer.scenario)
        try:
            write_text(path, encoded(answer))
        except OSError as error:
            message = f"{error.strerror}; earlier answers stay in the store: free some space and run again"
            raise OSError(error.errno, message, str(path)) from error


def stored_answers(folder: str | Path, scenario: Scenario) -> list[Answer]:
    """Return all readable answers for a scenario in a folder, whatever solver and options they come from."""
    found = []
    for path in sorted(Path(folder).glob(f"{scenario.digest[:20]}-*.json")):
        try:
            found.append(decoded(path.read_text(encoding="utf-8"), scenario))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue
    return found


def encoded(answer: Answer) -> str:
    """Return an answer as the text of its file.

    Raises:
        TypeError: for values without a plain form, such as the trajectories of the flat method.
    """
    kind = type(answer).__name__
    # Corridors belong to the trajectories of the flat method, which have no plain form either.
    names = [field.name for field in fields(answer) if field.name != "corridors"]
    values = {name: _plain(getattr(answer, name)) for name in names}
    body = {"kind": kind, "answer": values}
    head = {"schema": SCHEMA, "version": flatgym.__version__, "sha256": _checksum(body)}
    return json.dumps(head | body, allow_nan=False) + "\n"


def decoded(text: str, scenario: Scenario) -> Answer:
    """Return the answer in the text of a file.

    Raises:
        ValueError: when it is damaged, of another version, or the answer for another scenario.
    """
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError("no answer in it")
    found = data.get("schema"), data.get("version")
    if found != (SCHEMA, flatgym.__version__):
        raise ValueError(
            f"written as schema {found[0]} by version {found[1]}, wanted {SCHEMA} by {flatgym.__version__}"
        )
    body = {key: data[key] for key in ("kind", "answer")}
    if data.get("sha256") != _checksum(body):
        raise ValueError("wrong checksum")
    values = {name: _value(name, value, scenario) for name, value in body["answer"].items()}
    if values["scenario"].digest != scenario.digest:
        raise ValueError(f"it is the answer for {values['scenario']}")
    values["scenario"] = scenario  # it may have another name
    return {"Solution": Solution, "FewestSteps": FewestSteps}[body["kind"]](**values)


def _checksum(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Return one field of an answer as plain JSON data; a number that is not finite becomes {"number": "inf"}."""
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
    raise TypeError(f"a store cannot hold a {type(value).__name__}; leave out store=")


def _value(name: str, plain: Any, scenario: Scenario) -> Any:
    """Return one field of an answer for a scenario from its plain JSON data."""
    if name == "scenario":
        return Scenario.from_dict(plain)
    if name == "status":
        return Status[plain]
    value = _numbers(plain)
    if name == "certificate":
        return Certificate(**value)
    if name == "trajectory" and value is not None:
        breakpoints, states, controls = (np.array(array, dtype=np.float64) for array in value)
        return Trajectory(breakpoints, states, controls, scenario.quadrotor)
    if name in ("actions", "states"):
        width, kind = (2, np.float32) if name == "actions" else (5, np.float64)
        return np.array(value, dtype=kind).reshape(-1, width)
    return value


def _numbers(plain: Any) -> Any:
    """Return plain data with every {"number": "inf"} turned back into a number."""
    if isinstance(plain, list):
        return [_numbers(entry) for entry in plain]
    if isinstance(plain, dict):
        if set(plain) == {"number"}:
            return float(plain["number"])
        return {key: _numbers(entry) for key, entry in plain.items()}
    return plain
