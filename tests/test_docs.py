"""The documentation: everything public has a docstring, the site builds strictly and loads nothing from the net."""

import ast
import re
import runpy
import tomllib
import warnings
from html.parser import HTMLParser
from urllib.parse import unquote

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config

from experiments.files import ROOT
from flatgym import __version__

HOOKS = runpy.run_path(str(ROOT / "docs" / "hooks.py"))
FILES = [file for package in HOOKS["PACKAGES"] for file in sorted((ROOT / package).rglob("*.py"))]
OVERRIDDEN = {"forward", "backward"}
"""Methods that torch calls and documents."""
LOADED = {
    "script": "src",
    "link": "href",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "object": "data",
}
"""Elements whose files a browser loads by itself, and the attribute that names them."""


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


def test_everything_public_has_a_docstring():
    found = {f"{file.relative_to(ROOT).as_posix()}: {name}" for file in FILES for name in undocumented(file)}
    assert not found


class Links(HTMLParser):
    """What a page loads and links to, and the ids in it."""

    def __init__(self, text):
        super().__init__()
        self.loaded, self.links, self.ids = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.ids |= {attributes[key] for key in ("id", "name") if attributes.get(key)}
        if tag in LOADED and attributes.get(LOADED[tag]):
            self.loaded.append(attributes[LOADED[tag]])
        self.links += [attributes[key] for key in ("href", "src") if attributes.get(key)]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built as `make docs` does: a warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    with warnings.catch_warnings():
        # Dependencies of MkDocs warn of each other's future.
        warnings.simplefilter("ignore")
        build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder), strict=True))
    return folder


@pytest.fixture(scope="module")
def pages(site):
    """The pages of the site by their place in it."""
    return {
        page.relative_to(site).as_posix(): Links(page.read_text(encoding="utf-8"))
        for page in sorted(site.rglob("*.html"))
    }


def test_every_page_and_every_public_module_is_in_the_site(pages):
    written = {page.stem for page in (ROOT / "docs").glob("*.md")} | {"contributing", "changelog"}
    assert {f"{name}.html" for name in written} <= set(pages)
    ids = {name for page in pages.values() for name in page.ids}
    for package in HOOKS["PACKAGES"]:
        for folder in HOOKS["folders"](package):
            assert f"api/{folder}.html" in pages
            assert set(HOOKS["modules"](folder)) <= ids
    assert {"flatgym.quadrotor.Quadrotor.step", "optimal.minimum_time.solve"} <= ids


def test_no_page_loads_anything_from_the_net(site, pages):
    for name, page in pages.items():
        assert [url for url in page.loaded if re.match(r"(https?:)?//", url)] == [], name
    for style in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import )['\"]?(https?:)?//", style.read_text(encoding="utf-8")), style


def test_every_link_and_anchor_of_the_site_exists(site, pages):
    for name, page in pages.items():
        if name == "404.html":  # served for any address, so its links begin at the root
            continue
        for link in page.links:
            path, _, anchor = unquote(link).partition("#")
            if re.match(r"\w+:", link):
                continue
            target = (site / name).parent / path if path else site / name
            assert target.resolve().exists(), f"{name}: {link}"
            if anchor and target.suffix == ".html":
                found = pages[target.resolve().relative_to(site.resolve()).as_posix()]
                assert anchor in found.ids or anchor == "__comments", f"{name}: {link}"


def test_formulas_are_mathml(site):
    text = (site / "environment.html").read_text(encoding="utf-8")
    assert text.count("<math") > 10
    assert "arithmatex" not in re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    assert HOOKS["mathml"]("a &lt; b", block=True) == HOOKS["mathml"]("a < b", block=True)


def test_the_search_works_from_the_file_system(site, browser):
    asked = []
    tab = browser.new_page()
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto((site / "index.html").as_uri())
    tab.click("[data-md-component=search-query]")
    tab.keyboard.type("hamiltonian drift")
    tab.wait_for_selector(".md-search-result__link[href*='optimum.html']", state="attached")
    tab.close()
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


def test_the_new_names_of_modules_in_the_changelog_exist():
    package, found = "", 0
    for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines():
        if heading := re.match(r"\| (\w+): old \| new \|", line):
            package = heading[1]
        elif package and line.startswith("| `"):
            for name in re.findall(r"`([\w/]+)`", line.split("|")[2]):
                assert (ROOT / package / f"{name}.py").exists() or (ROOT / f"{name}.py").exists(), line
                found += 1
        elif line.startswith("####"):
            package = ""
    assert found > 100


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
