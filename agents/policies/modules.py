"""Objects of the user's own modules: "module:object" and "file.py:object".

Importing runs that code. The working directory and the folder of a file come last among the places where Python looks
for modules, so neighbours are found, and a file named numpy.py or random.py replaces nothing. The object itself is
always the user's: a module of the working directory comes before an installed one of its name. A folder with the name
of one of our packages, such as agents/, adds its modules to ours.
"""

from __future__ import annotations

import ast
import difflib
import importlib.util
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

OURS = ("flatgym", "optimal", "agents", "experiments")
"""Our packages."""


def check_place(name: str, suffixes: tuple[str, ...]) -> None:
    """Raise a ValueError unless a name is "module:object", "file.py:object", or a file of one of the suffixes."""
    if name.endswith(suffixes) or (":" in name and not name.startswith(":") and not name.endswith(":")):
        return
    path = Path(name.rstrip(":"))
    if path.suffix == ".py":
        found = defined(path)
        there = f"it defines {', '.join(found) or 'nothing'}" if path.is_file() else "there is no such file"
        raise ValueError(
            f"{name} is a Python file: name the policy in it, as in {path}:{found[0] if found else 'policy'}; {there}"
        )
    near = [file for end in (*suffixes, ".py") if (file := Path(f"{path}{end}")).is_file()]
    hint = f"; did you mean {near[0]}{':object' if near[0].suffix == '.py' else ''}?" if near else ""
    raise ValueError(
        f"{name!r} is neither a file of a policy ({', '.join(suffixes)}) nor of the form module:object, as in "
        f"my_module:policy{hint}"
    )


def defined(path: Path) -> list[str]:
    """Return the public names that a Python file defines at its top level, without running it."""
    try:
        body = ast.parse(path.read_text(encoding="utf-8")).body
    except (OSError, ValueError, SyntaxError):
        return []
    names = []
    for part in body:
        if isinstance(part, (ast.FunctionDef, ast.ClassDef)):
            names.append(part.name)
        if isinstance(part, ast.Assign):
            names += [target.id for target in part.targets if isinstance(target, ast.Name)]
    return [name for name in names if not name.startswith("_")]


def load_object(name: str) -> Any:
    """Return the object that "module:object" or "file.py:object" names.

    Raises:
        ValueError: if it is not found or cannot be imported.
    """
    place, _, thing = name.rpartition(":")
    module = load_module(place)
    if not hasattr(module, thing):
        public = [word for word in vars(module) if not word.startswith("_")]
        near = difflib.get_close_matches(thing, public, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; it has {', '.join(public) or 'nothing'}"
        raise ValueError(f"module {place!r} has no {thing!r}{hint}")
    return getattr(module, thing)


def load_module(place: str) -> ModuleType:
    """Return a module by its name, that of the working directory first, or by its file; errors as in `load_object`."""
    own = Path(place) if place.endswith(".py") else own_file(place)
    add_places(Path.cwd(), *([own.resolve().parent] if own is not None and place.endswith(".py") else []))
    try:
        if place.endswith(".py"):
            return _of_file(Path(place))
        if own is None:
            return import_module(place)
        try:
            module = import_module(place)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{place}.".startswith(f"{error.name}."):
                raise  # what the user's module imports is missing
            return _of_file(own)
        # An installed module has the name of the user's.
        return module if Path(str(module.__file__)).resolve() == own.resolve() else _of_file(own)
    except Exception as error:  # importing runs arbitrary code
        hidden = "".join(
            f"; the folder {name}/ has the name of a package of FlatQuad, which comes first: rename the folder"
            for name in OURS
            if shadowed(name, Path.cwd()) and name in str(error)
        )
        raise ValueError(f"{place!r} cannot be imported: {type(error).__name__}: {error}{hidden}") from error


def own_file(place: str) -> Path | None:
    """Return the file of a dotted module name below the working directory, None if there is none."""
    path = Path(*place.split("."))
    return next((file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()), None)


def add_places(*folders: Path) -> None:
    """Let Python look for modules in folders, after all other places; see the module's docstring for our names."""
    for folder in folders:
        if str(folder) not in sys.path:
            sys.path.append(str(folder))
        for name in OURS:
            if shadowed(name, folder) and str(folder / name) not in (places := sys.modules[name].__path__):
                places.append(str(folder / name))


def shadowed(name: str, folder: Path) -> bool:
    """Return whether a folder has a sub-folder of the name of our package that is not our package."""
    if not (folder / name).is_dir():
        return False
    try:
        ours = Path(str(import_module(name).__file__)).parent
    except ImportError:  # an extra is missing, so the package is not in use
        return False
    return (folder / name).resolve() != ours.resolve()


def _of_file(path: Path) -> ModuleType:
    """Return the module of a file, under a name that no other module has."""
    name = f"flatquad_policy_{path.stem if path.stem != '__init__' else path.resolve().parent.name}"
    package = [str(path.parent)] if path.name == "__init__.py" else None
    found = importlib.util.spec_from_file_location(name, path, submodule_search_locations=package)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules[name] = module  # pickle and dataclasses look classes up there
    found.loader.exec_module(module)
    return module
