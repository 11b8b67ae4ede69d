"""Objects of one's own modules: neighbours are found, names of other packages are no trap, and mistakes are named."""

import sys

import numpy as np
import pytest

from agents.policies import modules
from agents.policies.adapters import load_policy
from agents.policies.modules import check_place, load_object

ACT = "def act(seen):\n    return seen[..., :2] * 0 + {value}\n"
SEEN = np.zeros((3, 19), dtype=np.float32)


@pytest.fixture
def home(tmp_path, monkeypatch):
    """The working directory, with Python's modules and places as before afterwards."""
    known, places, ours = dict(sys.modules), list(sys.path), list(sys.modules["agents"].__path__)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name in set(sys.modules) - set(known):
        del sys.modules[name]
    sys.modules.update(known)
    sys.path[:] = places
    sys.modules["agents"].__path__[:] = ours


def write(home, **files):
    """Write Python files; in their names "_of_" stands for a folder's slash."""
    for name, text in files.items():
        path = home / (name.replace("_of_", "/") + ".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def value(name):
    return float(load_policy(name).predict(SEEN)[0][0, 0])


@pytest.mark.parametrize("name", ["mine_flatquad:act", "mine_flatquad.py:act", "deep.mine_flatquad:act"])
def test_neighbours_are_imported(home, name):
    for folder in ("", "deep_of_"):
        write(home, **{f"{folder}mine_flatquad": f"from neighbour_flatquad import GAIN\n{ACT.format(value='GAIN')}"})
    write(home, neighbour_flatquad="GAIN = 0.5\n")
    assert value(name) == 0.5


def test_neighbours_of_a_file_elsewhere_are_imported(home):
    write(home, far_of_mine_flatquad=f"from near_flatquad import GAIN\n{ACT.format(value='GAIN')}")
    write(home, far_of_near_flatquad="GAIN = 0.25\n")
    assert value("far/mine_flatquad.py:act") == 0.25


def test_neighbours_are_found_while_flying(home):
    write(home, late_flatquad="GAIN = 0.125\n")
    write(
        home,
        mine_flatquad="def act(seen):\n    import late_flatquad as l\n    return seen[..., :2] * 0 + l.GAIN\n",
    )
    assert value("mine_flatquad:act") == 0.125


@pytest.mark.parametrize("name", ["numpy", "random", "json", "torch"])
@pytest.mark.parametrize("form", ["{}:act", "{}.py:act"])
def test_a_file_with_the_name_of_a_library_is_the_users_and_replaces_nothing(home, name, form):
    import random

    write(
        home,
        **{
            name: "import numpy, random, json\nassert numpy.pi and random.random and json.dumps\n"
            + ACT.format(value=0.75)
        },
    )
    assert value(form.format(name)) == 0.75
    __import__(name)
    assert str(home) not in str(sys.modules[name].__file__)
    assert random.random() < 1


@pytest.mark.parametrize("package", ["agents", "experiments"])
@pytest.mark.parametrize("init", [False, True])
def test_a_folder_with_the_name_of_our_package_adds_to_it(home, package, init):
    write(
        home,
        **{
            f"{package}_of_mine": f"from agents import CascadedPD\nfrom {package}.gains import GAIN\n"
            + ACT.format(value="GAIN"),
            f"{package}_of_gains": "GAIN = 0.5\n",
        },
    )
    if init:
        write(home, **{f"{package}_of___init__": "raise SystemError('not ours')\n"})
    assert value(f"{package}.mine:act") == 0.5


@pytest.mark.parametrize("name", ["agents.policies", "agents.evaluation", "flatgym.task"])
def test_a_module_with_the_name_of_one_of_ours_is_the_users(home, name):
    write(home, **{name.replace(".", "_of_"): ACT.format(value=0.375)})
    assert value(f"{name}:act") == 0.375
    assert value(f"{name.replace('.', '/')}.py:act") == 0.375


def test_the_package_itself_is_the_users(home):
    write(home, agents_of___init__=ACT.format(value=0.625))
    assert value("agents:act") == 0.625


def test_what_our_package_hides_is_named_in_one_line(home):
    write(
        home,
        agents_of___init__="class Helper: pass\n",
        agents_of_mine=f"from agents import Helper\n{ACT.format(value=0)}",
    )
    with pytest.raises(
        ValueError, match=r"'agents\.mine' cannot be imported: ImportError.*the folder agents/ has the name"
    ) as e:
        load_policy("agents.mine:act")
    assert "\n" not in str(e.value)


def test_a_missing_neighbour_is_named(home):
    write(home, mine_flatquad="import nowhere_flatquad\n")
    with pytest.raises(
        ValueError, match="'mine_flatquad' cannot be imported: ModuleNotFoundError: No module named 'now"
    ):
        load_object("mine_flatquad:act")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "mine.py",
            r"mine\.py is a Python file: name the policy in it, as in mine\.py:act; it defines act, Pilot, LIMIT",
        ),
        ("mine.py:", r"mine\.py: is a Python file: name the policy in it, as in mine\.py:act"),
        ("nowhere.py", r"nowhere\.py is a Python file: .* as in nowhere\.py:policy; there is no such file"),
        ("mine", r"'mine' is neither a file of a policy \(\.zip, \.onnx\) nor .*did you mean mine\.py:object\?"),
        ("model", r"'model' is neither .*did you mean model\.zip\?"),
        (":act", "':act' is neither a file"),
        ("nothing", "'nothing' is neither a file of a policy .* as in my_module:policy$"),
    ],
)
def test_a_forgotten_object_is_asked_for(home, name, words):
    write(home, mine="def act(seen): ...\nclass Pilot: ...\nLIMIT = 3\n_HIDDEN = 4\n")
    (home / "model.zip").touch()
    with pytest.raises(ValueError, match=words):
        check_place(name, (".zip", ".onnx"))


def test_the_names_of_a_file_are_read_without_running_it(home):
    write(home, mine="raise SystemExit\ndef act(seen): ...\n", broken="def act(:\n")
    assert modules.defined(home / "mine.py") == ["act"]
    assert modules.defined(home / "broken.py") == modules.defined(home / "nowhere.py") == []


def test_names_of_the_working_directory_come_first(home):
    write(home, onnx=ACT.format(value=0.875))
    assert value("onnx:act") == 0.875
