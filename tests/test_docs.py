"""The documentation: everything public says what it is, pdoc can render it, and the citation is of this version."""

import ast
import re
import runpy
import tomllib
import warnings

import pytest
from pdoc.extract import walk_specs

import optimal
from experiments.files import ROOT
from flatgym import __version__

DOCS = runpy.run_path(str(ROOT / "docs" / "build.py"))
FILES = [file for package in DOCS["PACKAGES"] for file in sorted((ROOT / package).rglob("*.py"))]
OVERRIDDEN = {"forward", "backward"}
"""Methods that torch calls and documents."""


def undocumented(file):
    """Yield what a file defines in public without a docstring: the module, functions, classes and their methods."""
    module = ast.parse(file.read_text(encoding="utf-8"))
    if not ast.get_docstring(module):
        yield "the module"
    classes = [node for node in module.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    for owner in [module, *classes]:
        for node in owner.body:
            if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
                continue
            overload = any(ast.unparse(decorator) == "overload" for decorator in node.decorator_list)
            if not (ast.get_docstring(node) or overload or (owner is not module and node.name in OVERRIDDEN)):
                yield node.name


def test_everything_public_says_what_it_is():
    found = {f"{file.relative_to(ROOT).as_posix()}: {name}" for file in FILES for name in undocumented(file)}
    assert not found


@pytest.mark.parametrize("package", DOCS["PACKAGES"])
def test_pages_are_of_public_modules_and_none_of_them_runs_when_imported(package):
    modules = DOCS["modules"](package)
    assert modules[0] == package
    assert len(set(modules)) == len(modules)
    assert all(re.fullmatch(r"[a-z]\w*(\.[a-z]\w*)*", name) for name in modules)
    with warnings.catch_warnings(action="ignore"):  # names that pdoc finds twice
        rendered = walk_specs(DOCS["specifications"](modules))
    assert set(modules) <= set(rendered)
    assert not any(name.startswith("experiments.walkthroughs.") for name in rendered)


def test_pdoc_renders_a_page_for_every_module(tmp_path):
    names = DOCS["build"](tmp_path, ("flatgym",))
    pages = {
        page.relative_to(tmp_path).with_suffix("").as_posix().replace("/", ".") for page in tmp_path.rglob("*.html")
    }
    assert pages == {*names, "index"}
    assert "exact" in (tmp_path / "flatgym" / "quadrotor.html").read_text(encoding="utf-8")


def test_names_imported_when_asked_for_are_found():
    names, before = vars(optimal), set(vars(optimal))
    DOCS["resolve"]("optimal")
    try:
        assert set(optimal.__all__) <= names.keys()
    finally:  # so that other tests may still put another name in its place
        for name in set(names) - before:
            del names[name]


def test_the_citation_is_of_this_version_and_licence():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = dict(re.findall(r'^([\w-]+): "?(.+?)"?$', text, re.MULTILINE))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert cited["cff-version"] == "1.2.0"
    assert cited["version"] == __version__
    assert cited["license"] == project["license"]
    assert cited["title"].startswith("FlatQuad")
    assert cited["message"]
    assert re.findall(r"^  - name: (.+)$", text, re.MULTILINE) == ["The FlatQuad developers"]
    assert re.findall(r"^  - ([\w-]+)$", text, re.MULTILINE) == project["keywords"]
