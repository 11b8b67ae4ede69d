"""A Chromium is found in the stated order, installed by the stated means, and a missing one is reported."""

import os
import sys
import time

import pytest

from tests import browser


@pytest.fixture
def machine(monkeypatch, tmp_path):
    """A bare machine: no browser, no package manager, no root; returns its folder of commands."""
    monkeypatch.delenv(browser.VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(browser, "APPLICATIONS", ())
    monkeypatch.setattr(browser, "PLAYWRIGHT", (str(tmp_path / "playwright"),))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    return tmp_path


def executable(path, script):
    """Write a shell script that can be run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


def chromium(path):
    """Write a browser that knows its version."""
    return executable(path, "echo Chromium 1.2.3")


def playwright(machine, script="exit 1"):
    """Write a Playwright whose download goes to the folder `own`, done by a script."""
    executable(
        machine / "playwright",
        f'case "$2" in --dry-run) echo "  Install location:  {machine}/own";; *) {script};; esac',
    )


@pytest.mark.usefixtures("machine")
def test_a_bare_machine_has_none():
    assert browser.find() is None
    assert browser.install() is None


def test_the_variable_comes_first_then_commands_then_the_download(machine, monkeypatch):
    playwright(machine)
    own = chromium(machine / "own" / "linux64" / "chrome-headless-shell")
    assert browser.find() == own
    command = chromium(machine / "google-chrome")
    assert browser.find() == command
    chosen = chromium(machine / "elsewhere" / "mine")
    monkeypatch.setenv(browser.VARIABLE, chosen)
    assert browser.find() == chosen


@pytest.mark.parametrize("script", ["exit 127", "echo install the snap", "echo Chromium 1.2.3; exit 1"])
def test_what_does_not_start_as_a_browser_is_passed_over(machine, monkeypatch, script):
    broken = executable(machine / "chromium", script)
    assert browser.find() is None
    command = chromium(machine / "google-chrome")
    assert browser.find() == command
    monkeypatch.setenv(browser.VARIABLE, broken)
    with pytest.raises(ValueError, match=f"FLATQUAD_CHROMIUM is '{broken}', which does not start as a browser"):
        browser.find()


def test_the_download_is_tried_first(machine):
    chromium(machine / "template")
    playwright(machine, f"/bin/mkdir -p {machine}/own/a && /bin/cp {machine}/template {machine}/own/a/headless_shell")
    executable(machine / "brew", f"/bin/touch {machine}/used")
    assert browser.install() == str(machine / "own" / "a" / "headless_shell")
    assert not (machine / "used").exists()


def test_root_installs_the_package_where_the_download_is_refused(machine, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    playwright(machine)
    chromium(machine / "template")
    executable(machine / "env", 'shift; exec "$@"')
    executable(
        machine / "apt-get",
        f'echo "$*" >> {machine}/log; test "$1" = update || /bin/cp {machine}/template {machine}/chromium',
    )
    assert browser.install() == str(machine / "chromium")
    assert (machine / "log").read_text().splitlines() == ["update -q", "install -y -q chromium"]


def test_passwordless_sudo_is_used_and_one_that_asks_is_not(machine):
    sudo = executable(machine / "sudo", "exit 0")
    assert browser.privilege() == [sudo, "-n"]
    executable(machine / "sudo", "exit 1")
    assert browser.privilege() is None
    executable(machine / "apt-get", f"touch {machine}/used")
    assert browser.install() is None
    assert not (machine / "used").exists()


def test_libraries_are_added_to_a_download_that_does_not_start(machine, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    chromium(machine / "template")
    shell = machine / "own" / "a" / "headless_shell"
    executable(shell, "exit 127")
    playwright(machine, f'test "$1" = install-deps && /bin/cp {machine}/template {shell}')
    assert browser.install() == str(shell)


def test_a_download_that_hangs_is_ended_with_all_it_started(machine):
    child = f"{sys.executable} -c 'import time, pathlib; time.sleep(1); pathlib.Path(\"{machine}/late\").touch()'"
    begun = time.monotonic()
    assert not browser.attempt([executable(machine / "hangs", f"{child}")], 0.2)
    assert time.monotonic() - begun < 0.9
    time.sleep(1.2)
    assert not (machine / "late").exists()


def test_the_path_is_printed_or_the_way_out_noted(machine, capsys):
    note = machine / "note"
    assert browser.main(note) == 1
    assert note.read_text() == browser.MISSING
    assert capsys.readouterr().err.splitlines()[-1] == browser.MISSING
    path = chromium(machine / "chromium")
    assert browser.main(note) == 0
    assert note.read_text() == ""
    assert capsys.readouterr().out == f"{path}\n"
