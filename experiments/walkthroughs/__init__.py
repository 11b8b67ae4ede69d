"""Walk-throughs: FlatQuad from end to end, one script each for reinforcement learning, control and imitation learning.

    python -m experiments.walkthroughs.reinforcement    # train PPO, and score it against the optimum
    python -m experiments.walkthroughs.control          # a scenario of your own: solve, certify, prove, compare
    python -m experiments.walkthroughs.imitation        # record optimal flights, clone, DAgger, fine-tune with PPO

The scripts consist of `# %%` cells. VS Code, Spyder and Jupyter (with jupytext) open them as notebooks. All code is at
the top level: importing a script runs it. With `--quick` each takes seconds and learns almost nothing. Results go to
experiments/results/walkthroughs in the working directory.
"""

__all__: tuple[str, ...] = ()  # tools that import listed modules would run them
