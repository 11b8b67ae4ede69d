"""The house: packages carry their types, and a missing extra is named with the line that installs it."""

from importlib.resources import files

import pytest

from flatgym import __version__
from flatgym.extras import require


@pytest.mark.parametrize("package", ["flatgym", "optimal", "agents", "experiments"])
def test_packages_carry_their_types(package):
    assert (files(package) / "py.typed").is_file()


def test_a_missing_extra_is_named_with_the_way_out():
    require("optimal", "numpy")
    with pytest.raises(ImportError, match=r"no_such_module not installed; run: pip install 'flatgym\[optimal\]'"):
        require("optimal", "numpy", "no_such_module")


def test_the_version_stands_in_one_place():
    from importlib.metadata import version

    assert version("flatgym") == __version__
