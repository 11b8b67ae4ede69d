"""Help and version: every option of every command prints its whole help text; colours obey NO_COLOR."""

import inspect
import os
import pty
import subprocess
import sys
from typing import get_type_hints

import pytest
import typer
from typer.testing import CliRunner

from experiments.cli import app, measure
from experiments.cli.options import HELP_OPTIONS, Command
from experiments.files import ROOT
from flatgym import __version__

COMMANDS = {(command.name or command.callback.__name__,): command for command in app.app.registered_commands}
COMMANDS |= {
    ("measure", command.name or command.callback.__name__): command for command in measure.app.registered_commands
}


def printed_help(application, *arguments):
    """Return what a command prints as help, in one line and without the frames of the panels."""
    result = CliRunner().invoke(application, [*arguments], env={"COLUMNS": "400", "TERMINAL_WIDTH": "400"})
    assert result.exit_code == 0, result.output
    return " ".join(result.output.replace("│", " ").split())


@pytest.mark.parametrize("names", COMMANDS)
@pytest.mark.parametrize("option", HELP_OPTIONS["help_option_names"])
def test_help_prints_every_text_of_the_source(names, option):
    command = COMMANDS[names]
    printed = printed_help(app.app, *names, option)
    texts = [command.callback.__doc__, command.epilog]
    for hint in get_type_hints(inspect.unwrap(command.callback), include_extras=True).values():
        texts += [info.help for info in getattr(hint, "__metadata__", ()) if getattr(info, "help", None)]
    assert len(texts) > 2 or names == ("publish",)
    for text in texts:
        assert " ".join(text.split()) in printed


def test_help_of_a_command_keeps_brackets():
    own = typer.Typer(rich_markup_mode="rich", context_settings=HELP_OPTIONS)
    texts = ("Time [s] of [m/s^2] and [/s].", "See [bold] and [red]this[/red], \\[rad].", "Example: own --gap [0, 1]")

    @own.command(cls=Command, help=texts[1], epilog=texts[2])
    def run(time: float = typer.Option(1.0, help=texts[0])) -> None:
        pass

    assert all(text in printed_help(own, "-h") for text in texts)


def test_the_version_is_printed():
    result = CliRunner().invoke(app.app, ["--version"])
    assert (result.exit_code, result.output) == (0, f"flatquad {__version__}\n")


def on_terminal(*arguments, **variables):
    """Run `flatquad` on a pseudo-terminal and return what it prints."""
    main, terminal = pty.openpty()
    code = "import sys; sys.argv[0] = 'flatquad'; from experiments.cli.app import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT), "TERM": "xterm-256color", "COLUMNS": "60"} | variables,
        stdout=terminal,
        stderr=terminal,
        stdin=subprocess.DEVNULL,
    )
    os.close(terminal)
    printed = b""
    try:
        while part := os.read(main, 4096):
            printed += part
    except OSError:  # the end of a pseudo-terminal on Linux
        pass
    os.close(main)
    assert process.wait() in (0, 2)
    return printed.decode()


def test_no_color_leaves_no_escape_codes():
    assert "\x1b[" in on_terminal("solve", "hop")
    for arguments, words in ((("solve", "hop"), "unknown scenario"), (("solve", "-h"), "Usage"), (("list",), "slalom")):
        plain = on_terminal(*arguments, NO_COLOR="1")
        assert "\x1b" not in plain
        assert words in plain
