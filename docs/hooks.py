"""What MkDocs does besides its plugins: pages and pictures from elsewhere in the repository, the API, formulas.

on_config           adds the pages of the API to the navigation
on_files            adds published pictures, CONTRIBUTING, CHANGELOG and a page for every package and sub-package
on_page_markdown    points links to those files
on_page_content     turns formulas in TeX into MathML
Units               repairs docstrings for Markdown
"""

from __future__ import annotations

import ast
import html
import re
from pathlib import Path
from typing import Any

import griffe
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "experiments" / "results" / "published"
PACKAGES = ("flatgym", "optimal", "agents", "experiments")
RUNNING = "experiments.walkthroughs"
"""A package of scripts: it is documented, but none of its modules."""
COPIED = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
"""Pages that stand in the repository's root."""
LINKS = (
    (re.compile(r"\]\((?:\.\./)?experiments/results/published/"), "](pictures/"),
    (re.compile(r"\]\((?:\.\./)?CONTRIBUTING\.md"), "](contributing.md"),
    (re.compile(r"\]\((?:\.\./)?CHANGELOG\.md"), "](changelog.md"),
    (re.compile(r"\]\(docs/"), "]("),
)
"""Links that work in the repository, and where they point to in the site."""
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)

CELL = re.compile(r"<td[^>]*>[^<]*</td>")
SPACE = re.compile(r"(?<=\d) (?=[%kM]|MB\b|s\b)|(?<=\d,) (?=[\d.]+\])")
"""A space between a number and its unit, and the one inside an interval."""


def folders(package: str) -> list[str]:
    """Return the dotted names of a package and its sub-packages."""
    files = sorted((ROOT / package).rglob("__init__.py"))
    return [".".join(file.parent.relative_to(ROOT).parts) for file in files]


def modules(folder: str) -> list[str]:
    """Return the dotted names of the public modules of a package, sub-packages left out."""
    if folder == RUNNING:
        return []
    files = sorted((ROOT / folder.replace(".", "/")).glob("*.py"))
    return [f"{folder}.{file.stem}" for file in files if not file.stem.startswith("_")]


def exported(folder: str) -> dict[str, str]:
    """Return the names in `__all__` of a package with the full names of what they stand for."""
    module = ast.parse((ROOT / folder.replace(".", "/") / "__init__.py").read_text(encoding="utf-8"))
    imports = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in ast.walk(module)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    names: list[str] = []
    for node in module.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(node, ast.Assign) and isinstance(target, ast.Name) and target.id == "__all__":
            names = [str(name) for name in ast.literal_eval(node.value)]
    return {name: imports[name] for name in names if name in imports}


def page(folder: str) -> str:
    """Return the API page of a package: its docstring, what it exports, its sub-packages and its modules."""
    parts = [f"---\ntitle: {folder}\nsearch:\n  boost: 0.5\n---", documented(folder, alone=True)]
    names = [f"[`{name}`][{target}]" for name, target in exported(folder).items()]
    if names:
        parts.append(f"`from {folder} import ...`: " + ", ".join(names) + ".")
    inner = [name for name in folders(folder.replace(".", "/")) if name != folder]
    if inner:
        parts.append("Sub-packages: " + ", ".join(f"[`{name}`]({name}.md)" for name in inner) + ".")
    return "\n\n".join([*parts, *map(documented, modules(folder))])


def documented(name: str, *, alone: bool = False) -> str:
    """Return the directive that renders a module, or the docstring alone of the package a page is about."""
    options = "\n      heading_level: 1\n      members: false" if alone else ""
    return f"::: {name}\n    options:\n      show_root_full_path: true{options}"


class Units(griffe.Extension):
    """Keeps Markdown from reading an interval and its unit, "[0, 1] [s]", as a link."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Escape the unit in the docstring of an object."""
        if obj.docstring:
            obj.docstring.value = obj.docstring.value.replace("] [", "] \\[")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the pages of the API to the navigation, package by package."""
    assert config.nav is not None
    config.nav.append({"API": [{package: [f"api/{name}.md" for name in folders(package)]} for package in PACKAGES]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add pictures, pages of the repository's root, and the API."""
    for picture in sorted(PICTURES.glob("*.svg")) + sorted(PICTURES.glob("*.gif")):
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    for name, source in COPIED.items():
        files.append(File.generated(config, name, content=(ROOT / source).read_text(encoding="utf-8")))
    for package in PACKAGES:
        for name in folders(package):
            files.append(File.generated(config, f"api/{name}.md", content=page(name)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Point links to other folders of the repository to their places in the site."""
    for pattern, place in LINKS:
        markdown = pattern.sub(place, markdown)
    return markdown


def on_page_content(content: str, **_: Any) -> str:
    """Replace formulas in TeX by MathML, which browsers show without a script, and glue numbers in tables."""
    content = FORMULA.sub(lambda found: mathml(found[2], block=found[1] == "div"), content)
    return CELL.sub(lambda found: SPACE.sub("\N{NO-BREAK SPACE}", found[0]), content)


def mathml(tex: str, *, block: bool) -> str:
    """Return a formula in TeX as MathML."""
    return convert(html.unescape(tex).strip(), display="block" if block else "inline")
