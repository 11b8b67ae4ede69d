"""Walk-throughs: FlatQuad from end to end, one script for each kind of reader.

    python -m experiments.walkthroughs.reinforcement    # train PPO, and score it against the best flight there is
    python -m experiments.walkthroughs.control          # a scenario of one's own: solve, certify, prove, compare
    python -m experiments.walkthroughs.imitation        # record optimal flights, clone them, DAgger, on with PPO

They are written in `# %%` cells, so that VS Code, Spyder and Jupyter (by jupytext) open them as notebooks: everything
stands at the top level, and importing one runs it. With `--quick` each takes seconds and learns next to nothing.
What they write goes to experiments/results/walkthroughs, below the folder one is in.
"""

__all__: tuple[str, ...] = ()  # so that tools that document or complete import none of them, which would run it
