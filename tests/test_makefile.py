"""The Makefile: an environment for each Python, a sentence for a Python too old, a missing browser in the last line."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from experiments.files import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


@pytest.fixture
def checkout(tmp_path):
    """A folder with what the Makefile reads, and a Python whose version a file states."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def python(checkout, version):
    """Write an interpreter that says it has another version."""
    path = checkout / f"python{version}"
    numbers = ", ".join(version.split("."))
    path.write_text(
        f'#!/bin/sh\nexec {sys.executable} -c "import sys\nsys.version_info = ({numbers}, 0)\nexec(sys.argv[2])" "$@"\n'
    )
    path.chmod(0o755)
    return f"PYTHON={path}"


def make(checkout, *words):
    """Run make; return its exit status and output."""
    outer = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS", "PYTHON", "CORES")  # of a `make test` that runs this test
    done = subprocess.run(
        ["make", *words],
        cwd=checkout,
        env={name: value for name, value in os.environ.items() if name not in outer},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    return done.returncode, done.stdout


def environment(checkout, *words):
    """Return the virtual environment that make would use."""
    (folder,) = set(re.findall(r"(\.venv[\w.-]*)/bin/ruff", make(checkout, "-n", "format", *words)[1]))
    return folder


def test_another_python_gets_an_environment_of_its_own(checkout):
    assert environment(checkout, python(checkout, "3.13")) == ".venv"
    (checkout / ".venv").mkdir()
    for key in ("version", "version_info"):
        (checkout / ".venv" / "pyvenv.cfg").write_text(f"home = /usr/bin\n{key} = 3.12.1\n")
        assert environment(checkout, python(checkout, "3.12")) == ".venv"
        assert environment(checkout, python(checkout, "3.13")) == ".venv-3.13"
        assert environment(checkout, python(checkout, "3.1")) == ".venv-3.1"


def test_an_old_or_missing_python_is_refused_in_one_sentence(checkout):
    status, output = make(checkout, "check", python(checkout, "3.10"))
    assert status != 0
    assert "FlatQuad needs Python 3.11 or newer, and " in output
    assert "is 3.10: name a newer one, as in make test PYTHON=python3.13" in output
    status, output = make(checkout, "check", "PYTHON=nothing")
    assert status != 0
    assert "nothing does not run: name a Python of version 3.11 or newer" in output


@pytest.mark.parametrize(("suite", "note"), [(0, ""), (1, ""), (1, "No browser, set FLATQUAD_CHROMIUM=/x")])
def test_the_last_line_says_that_the_browser_is_missing(checkout, suite, note):
    chosen = python(checkout, "3.12")
    commands = checkout / ".venv" / "bin"
    commands.mkdir(parents=True)
    (checkout / ".venv" / "pyvenv.cfg").write_text("version = 3.12.1\n")
    (commands / "python").write_text(f'#!/bin/sh\ntest "$1" = -m && exit {suite}\nprintf "%s" "{note}" > "$2"\n')
    (commands / "python").chmod(0o755)
    (checkout / ".venv" / "installed").touch()
    status, output = make(checkout, "test", chosen)
    assert (status == 0) == (suite == 0)
    assert (note in output.splitlines()[-1]) if note else ("browser" not in output)


def test_help_lists_every_target(checkout):
    targets = set(re.findall(r"^([a-z]+):", (checkout / "Makefile").read_text(), re.MULTILINE)) - {"suite"}
    assert {line.split()[1] for line in make(checkout, "help")[1].splitlines() if line.startswith("make ")} == targets
