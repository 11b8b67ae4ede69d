"""The check for optional dependencies."""

from importlib.util import find_spec


def require(extra: str, *modules: str) -> None:
    """Raise an ImportError with the pip command if a module of an extra is missing.

    Args:
        extra: the extra of `flatgym` that installs the modules.
        modules: names of top-level modules.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise ImportError(f"{', '.join(missing)} not installed; run: pip install 'flatgym[{extra}]'")
