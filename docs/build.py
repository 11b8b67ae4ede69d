"""The API reference, made from the docstrings by pdoc: `make docs`, then open build/docs/index.html.

pdoc lists what a package names in `__all__`; here every public module has a page, which its place in the list of
files already explains. The walk-throughs have none, because importing one runs it.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import pdoc
import pdoc.render

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("flatgym", "optimal", "agents", "experiments")
RUNNING = "experiments.walkthroughs."
"""How the names of modules begin that run when imported."""


def modules(package: str) -> list[str]:
    """Return the dotted names of a package and of its public modules, but for those that run when imported."""
    names = [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in sorted((ROOT / package).rglob("*.py"))]
    names = [name.removesuffix(".__init__") for name in names]
    return [name for name in names if "._" not in name and not name.startswith(RUNNING)]


def specifications(names: Sequence[str]) -> list[str]:
    """Return what pdoc is to be told; named packages bring all their modules, so those that run are left out anew."""
    return [*names, f"!{re.escape(RUNNING)}"]


def resolve(package: str) -> None:
    """Put the names that a package imports only when asked for where pdoc looks for them."""
    module = import_module(package)
    for name in getattr(module, "__all__", ()):
        module.__dict__[name] = getattr(module, name)


def build(folder: Path, packages: Sequence[str] = PACKAGES) -> list[str]:
    """Write a page for every public module of the packages to a folder; return the modules' names."""
    names = [name for package in packages for name in modules(package)]
    for package in packages:
        resolve(package)
    # Without the sources, which stand in the repository: to colour them takes longer than all the rest.
    pdoc.render.configure(docformat="google", show_source=False, footer_text="FlatQuad")
    with warnings.catch_warnings():
        # Every module is named, and those that `__all__` names too are so twice; one page is written all the same.
        warnings.filterwarnings("ignore", message="The module specification")
        # Annotations of named tuples cannot be resolved where collections made their methods; they stand as written.
        warnings.filterwarnings("ignore", message="Error parsing type annotation")
        # torch's own classes, where a module has a short name for one.
        warnings.filterwarnings("ignore", message="Cannot determine where")
        pdoc.pdoc(*specifications(names), output_directory=folder)
    return names


if __name__ == "__main__":
    print(f"{len(build(Path(sys.argv[1])))} modules: {sys.argv[1]}/index.html")
