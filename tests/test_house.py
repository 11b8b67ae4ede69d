"""The house: packages carry their types, and a missing extra is named with the line that installs it."""

import inspect
from importlib.resources import files
from pathlib import Path

import pytest

import flatgym
from flatgym import __version__
from flatgym.extras import require

PACKAGES = ("flatgym", "optimal", "agents", "experiments")
ROOT = Path(flatgym.__file__).parents[1]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
]


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_carry_their_types(package):
    assert (files(package) / "py.typed").is_file()


def test_a_missing_extra_is_named_with_the_way_out():
    require("optimal", "numpy")
    with pytest.raises(ImportError, match=r"no_such_module not installed; run: pip install 'flatgym\[optimal\]'"):
        require("optimal", "numpy", "no_such_module")


def test_the_version_stands_in_one_place():
    from importlib.metadata import version

    assert version("flatgym") == __version__


@pytest.mark.parametrize("name", [name for name in MODULES if not name.startswith("experiments.walkthroughs.")])
def test_the_import_statement_gives_every_module_and_no_function_of_its_name(name):
    scope = {}
    exec(f"import {name} as module", scope)  # the statement, because importlib would not see what hides a module
    assert inspect.ismodule(scope["module"])
    assert scope["module"].__name__ == name


def test_no_folder_holds_more_than_fifteen_modules():
    folders = {path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    sizes = {folder.relative_to(ROOT).as_posix(): len(list(folder.glob("*.py"))) for folder in folders}
    assert {name: size for name, size in sizes.items() if size > 15} == {}
