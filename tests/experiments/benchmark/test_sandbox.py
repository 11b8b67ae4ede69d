"""Foreign code may answer, fail, hang or crash: whoever asked is told, in time."""

import time

import pytest

from experiments.benchmark.sandbox import Failed, run_isolated


def test_an_answer_comes_back():
    assert run_isolated("builtins:divmod", 17, 5, seconds=60) == [3, 2]


def test_an_error_comes_back():
    with pytest.raises(Failed, match="ValueError: invalid literal"):
        run_isolated("builtins:int", "seventeen", seconds=60)


def test_who_hangs_is_stopped():
    begun = time.perf_counter()
    with pytest.raises(Failed, match=r"no answer within 0\.5 s; --timeout grants more"):
        run_isolated("time:sleep", 600, seconds=0.5)
    assert time.perf_counter() - begun < 100


def test_who_ends_his_process_is_told_of():
    with pytest.raises(Failed, match="ended without an answer, with exit code 7"):
        run_isolated("os:_exit", 7, seconds=60)


def test_what_is_printed_does_not_mix_with_the_answer(capfd):
    assert run_isolated("builtins:print", "hello", seconds=60) is None
    assert capfd.readouterr().out == ""


def test_a_folder_named_like_one_of_our_packages_does_not_stand_in_its_place(tmp_path):
    (tmp_path / "experiments").mkdir()
    (tmp_path / "experiments" / "__init__.py").write_text("raise SystemExit('not ours')")
    assert run_isolated("os:getcwd", seconds=60, home=tmp_path) == str(tmp_path)
