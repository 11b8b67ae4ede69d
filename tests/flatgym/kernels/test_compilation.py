"""Compiled functions work where numba's cache cannot be written, is damaged, and where numba is switched off."""

import importlib.util
import shutil
import subprocess
import sys

import numba
import numpy as np
import pytest

from flatgym.envs.fleet_selection import make_fleet
from flatgym.kernels import compilation

SOURCE = """
from flatgym.kernels.compilation import cached

@cached(error_model="numpy")
def square(x):
    return x * x
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache folder of its own; the first notice of the process is still to come."""
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "UserProvidedCacheLocator")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(compilation, "_told", [])
    compilation.sources.cache_clear()
    (tmp_path / "squares.py").write_text(SOURCE)
    return tmp_path


def square(folder):
    """Return the function, imported anew."""
    spec = importlib.util.spec_from_file_location("squares", folder / "squares.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.square


def test_compiled_code_is_stored_and_found(folder, capsys):
    assert square(folder)(3) == 9
    again = square(folder)
    assert again(3) == 9
    assert sum(again.stats.cache_hits.values()) == 1
    assert not capsys.readouterr().err


@pytest.mark.parametrize("place", ["a-file", "/dev/null/cache"])
def test_without_a_folder_it_is_compiled_in_memory_with_one_line(folder, monkeypatch, capsys, place):
    (folder / "a-file").touch()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder / place / "cache"))
    one, other = square(folder), square(folder)
    assert one(3) == other(3) == 9
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("flatgym: compiled code cannot be stored")
    assert "NUMBA_CACHE_DIR" in line


def test_a_folder_that_is_lost_before_the_first_call_is_no_error(folder, capsys):
    function = square(folder)
    for path in (folder / "cache").iterdir():
        path.rmdir()
    (folder / "cache").rmdir()
    (folder / "cache").touch()
    assert function(3) == 9
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_processes_that_store_at_once_do_not_mix_signatures(folder, monkeypatch):
    """A file is written whole, so what processes leave together is the union of what each leaves alone."""
    arguments = [3, 2.5, 2j, np.ones(2), np.ones(2, np.float32), np.ones((2, 2))]
    for n, argument in enumerate(arguments):
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder / str(n)))
        square(folder)(argument)
        shutil.copytree(folder / str(n), folder / "cache", dirs_exist_ok=True)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder / "cache"))
    again = square(folder)
    for argument in arguments:
        answer, expected = again(argument), argument * argument
        assert type(answer) is type(expected)
        np.testing.assert_array_equal(answer, expected, strict=True)
    assert sum(again.stats.cache_hits.values()) == len(arguments)


def test_a_change_in_any_file_of_the_folder_compiles_again(folder):
    square(folder)(3)
    (folder / "neighbour.py").write_text("THREE = 3")
    compilation.sources.cache_clear()
    again = square(folder)
    assert again(3) == 9
    assert not again.stats.cache_hits
    assert len(list(folder.glob("cache/*/*"))) == 1


def test_recompiling_removes_what_is_stored(folder):
    function = square(folder)
    function(3), function(2.5)
    function._cache.flush()
    assert not list(folder.glob("cache/*/*"))


@pytest.mark.parametrize("kept", [0, 20], ids=["empty", "truncated"])
def test_a_damaged_file_is_replaced_with_one_line(folder, capsys, kept):
    square(folder)(3)
    (file,) = folder.glob("cache/*/*")
    file.write_bytes(file.read_bytes()[:kept])
    assert square(folder)(3) == 9
    (line,) = capsys.readouterr().err.splitlines()
    assert "is damaged" in line
    again = square(folder)
    assert again(3) == 9
    assert sum(again.stats.cache_hits.values()) == 1
    assert not capsys.readouterr().err


SWITCHED_OFF = """
import gymnasium as gym, numpy as np, flatgym
env = gym.make("FlatQuad-v0", scenario="random-hoops")
first, _ = env.reset(seed=4)
after = env.step(np.ones(2, np.float32))[0]
envs = gym.make_vec("FlatQuad-v0", num_envs=3, scenario="random-hoops")
print(first.tolist() == envs.reset(seed=4)[0][0].tolist(), after.tolist() == envs.step(np.ones((3, 2)))[0][0].tolist())
import optimal
from optimal.proof.programme.tilt_program import _add_best
row = np.zeros(3)
_add_best(row, np.array([1.0, 5.0, 2.0]), np.array([3.0, 4.0, 1.0]), np.array([2.0, 0.0, 7.0]))
print(row.tolist())
"""


def test_numba_can_be_switched_off():
    environment = {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run([sys.executable, "-c", SWITCHED_OFF], capture_output=True, text=True, env=environment)
    assert (done.stdout.split("\n")[:2], done.stderr) == (["True True", "[3.0, 5.0, 7.0]"], "")


def test_the_fleet_is_in_numpy_where_numba_is_switched_off(monkeypatch):
    from flatgym.envs.config import EnvConfig
    from flatgym.scenarios.catalogue import problem

    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    assert type(make_fleet(EnvConfig(problem("hoop")), 2)).__name__ == "NumpyFleet"
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 0)
    assert type(make_fleet(EnvConfig(problem("hoop")), 2)).__name__ == "CompiledFleet"
