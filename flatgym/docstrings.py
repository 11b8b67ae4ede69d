"""What the docstring of a class says of its attributes."""

from __future__ import annotations

import inspect
import re

ENTRY = re.compile(r"^    ([\w, ]+): (.*)$")
CONTINUATION = re.compile(r"^        +(.*)$")


def listed(kind: type) -> dict[str, str]:
    """Return the entries of the section `Attributes:` in the docstring of a class; empty without one."""
    found: dict[str, str] = {}
    names: list[str] = []
    text = inspect.cleandoc(kind.__doc__ or "") + "\n\n"
    for line in text.partition("Attributes:\n")[2].partition("\n\n")[0].splitlines():
        if entry := ENTRY.match(line):
            names = [name.strip() for name in entry[1].split(",")]
            found |= dict.fromkeys(names, entry[2])
        elif (more := CONTINUATION.match(line)) and names:
            found |= dict.fromkeys(names, f"{found[names[0]]} {more[1]}")
    return found
