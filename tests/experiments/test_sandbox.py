"""External code may answer, print, fail, hang, exit or crash: the caller gets the result or a report, in time."""

import time

import pytest

from experiments.sandbox import Failed, run_isolated


def test_a_result_comes_back():
    assert run_isolated("builtins:divmod", 17, 5, seconds=60) == [3, 2]


def test_an_error_comes_back():
    with pytest.raises(Failed, match="ValueError: invalid literal"):
        run_isolated("builtins:int", "seventeen", seconds=60)


def test_a_hanging_process_is_stopped():
    began = time.perf_counter()
    with pytest.raises(Failed, match=r"no answer within 0\.5 s; --timeout grants more"):
        run_isolated("time:sleep", 600, seconds=0.5)
    assert time.perf_counter() - began < 100


@pytest.mark.parametrize(
    ("function", "arguments", "code"), [("os:_exit", [7], 7), ("sys:exit", [3], 3), ("os:abort", [], -6)]
)
def test_the_end_of_its_process_is_reported(function, arguments, code):
    with pytest.raises(Failed, match=f"ended without an answer, with exit code {code}"):
        run_isolated(function, *arguments, seconds=60)


@pytest.mark.parametrize(("function", "arguments"), [("builtins:print", ["hello"]), ("os:system", ["echo hello"])])
def test_output_does_not_mix_with_the_result(capfd, function, arguments):
    assert not run_isolated(function, *arguments, seconds=60)
    output = capfd.readouterr()
    assert (output.out, "hello" in output.err) == ("", True)


def test_a_folder_named_like_one_of_our_packages_does_not_replace_it(tmp_path):
    (tmp_path / "experiments").mkdir()
    (tmp_path / "experiments" / "__init__.py").write_text("raise SystemExit('not ours')")
    assert run_isolated("os:getcwd", seconds=60, home=tmp_path) == str(tmp_path)
