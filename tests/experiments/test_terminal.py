"""Tables on the terminal: no broken words, no lost brackets, good at 80 and at 60 columns."""

import pytest
from rich.console import Console

from experiments import terminal

HEAD = ["task", "agent", "gap to K*", "training time [s]"]
ROWS = [["random-goal", "open-loop replay", "+36.3 % [35.5, 37.0]", "1219"], ["hoop", "[bold]PPO", "-", "-"]]


@pytest.fixture
def printed(monkeypatch, capsys):
    """A function that prints a table at a width and returns its lines."""

    def lines(width, *arguments):
        monkeypatch.setattr(terminal, "screen", Console(width=width))
        terminal.table(*arguments)
        return capsys.readouterr().out.splitlines()

    return lines


def test_a_table_that_fits_has_a_line_for_each_row(printed):
    title, head, _, *rows, end = printed(80, "Scores [s]", HEAD, ROWS)
    assert title == "Scores [s]"
    assert end == ""
    assert head.split("  ")[-1] == "training time [s]"
    assert [row.split()[0] for row in rows] == ["random-goal", "hoop"]
    assert "[bold]PPO" in rows[1]


def test_a_narrow_table_wraps_between_words_and_keeps_numbers_with_their_units(printed):
    lines = printed(46, "Scores", HEAD, ROWS)
    assert max(map(len, lines)) <= 46
    words = " ".join(lines).split()
    assert {"random-goal", "open-loop", "replay", "1219", "training"} <= set(words)
    assert not any(word.endswith("-") and len(word) > 1 for word in words)
    assert any("+36.3 %" in line for line in lines)
    assert any("[35.5, 37.0]" in line for line in lines)


def test_optional_columns_are_left_out_before_rows_become_blocks(printed):
    assert not any("training" in line for line in printed(38, "Scores", HEAD, ROWS, ["training time [s]"]))
    blocks = printed(30, "Scores", HEAD, ROWS)
    assert blocks[1:3] == ["random-goal", "  agent: open-loop replay"]


def test_numbers_are_aligned_to_the_right():
    assert all(map(terminal.numeric, ["1.5", "+4.9 %", "-0.1", "-", "≤ 0.35 s", "67x"]))
    assert not any(map(terminal.numeric, ["hoop", "yes", "(5, 5)"]))


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("success_rate", 1, "100 %"),
        ("success_rate", 1.0, "100 %"),
        ("success_rate", 0.32, "32 %"),
        ("success_rate", 0.9996, "100.0 %"),
        ("gap", 0.3116, "+31.2 %"),
        ("gap", 1.02374, "+102.4 %"),
        ("gap", 0.00021, "+0.021 %"),
        ("gap", None, "-"),
        ("gap", float("nan"), "-"),
        ("gap", float("inf"), "inf"),
        ("time_s", 0.3116, "0.3116"),
    ],
)
def test_a_record_shows_shares_in_per_cent(monkeypatch, capsys, field, value, text):
    monkeypatch.setattr(terminal, "screen", Console(width=60))
    terminal.show_record({field: value}, as_json=False, title="Score")
    assert capsys.readouterr().out.splitlines()[1].split(maxsplit=1)[1] == text


@pytest.mark.parametrize("width", [60, 80])
def test_a_record_breaks_no_word_and_no_unit(monkeypatch, capsys, width):
    monkeypatch.setattr(terminal, "screen", Console(width=width))
    text = "an interval of +36.3 % [35.5, 37.0] within the limits of the vehicle [m/s^2] and of time, 5.25 s of 6 s"
    terminal.show_record({"status": text, "max_control_violation": 1e-12}, as_json=False, title="Solved [s]")
    title, *lines = capsys.readouterr().out.splitlines()
    assert title == "Solved [s]"
    assert max(map(len, lines)) <= width
    assert " ".join(" ".join(lines).split()) == f"status {text} max_control_violation 1e-12"
    assert not any(line.endswith(("36.3", "[35.5,", "5.25", "6")) for line in lines)


def test_standard_output_is_for_data_only_while_a_bar_is_shown(capsys):
    with terminal.progress_bar() as bar:
        bar.add_task("work", total=1, note="")
        print("a note of a library")
    print("data")
    output = capsys.readouterr()
    assert output.out == "data\n"
    assert "a note of a library" in output.err
