"""The command as a shell would run it, for the tests of all commands."""

import sys

import pytest

from experiments.cli import app


def flatquad(monkeypatch, capsys, *arguments):
    """Run `flatquad` with arguments; return exit status, standard output, and standard error in one line."""
    monkeypatch.setattr(sys, "argv", ["flatquad", *arguments])
    with pytest.raises(SystemExit) as end:
        app.main()
    output = capsys.readouterr()
    return end.value.code, output.out, " ".join(output.err.split())
