"""A clear word where an optional part is not installed."""

from importlib.util import find_spec


def require(extra: str, *modules: str) -> None:
    """Raise an ImportError with the pip line when a module of an extra is missing.

    Args:
        extra: the extra of the distribution that brings the modules.
        modules: names of top-level modules.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise ImportError(f"{', '.join(missing)} not installed; run: pip install 'flatgym[{extra}]'")
