"""`flatquad publish`: the tables and pictures of the README and the docs, from the latest results."""

from __future__ import annotations

from experiments.terminal import messages, progress_bar

EXAMPLES = "Example: flatquad benchmark && flatquad publish"


def publish() -> None:
    """Copy the latest results of this clone to the published ones; rebuild tables and pictures of README and docs.

    The pictures need the extra `figures` and a Chromium.
    """
    from experiments.files import PUBLISHED
    from experiments.publishing import publish as publishing

    with progress_bar() as bar:
        bar.add_task("publishing", total=None, note="")
        publishing.publish()
    messages.print(f"published: {PUBLISHED}", soft_wrap=True)
