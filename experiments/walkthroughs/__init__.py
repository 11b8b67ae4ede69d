"""Walk-throughs: FlatQuad from end to end, one script for each kind of reader.

    python -m experiments.walkthroughs.reinforcement    # train PPO, and score it against the optimum
    python -m experiments.walkthroughs.control          # a scenario of your own: solve, certify, prove, compare
    python -m experiments.walkthroughs.imitation        # record optimal flights, clone, DAgger, fine-tune with PPO
    python -m experiments.walkthroughs.planning         # gradient descent through the flight, in JAX
    python -m experiments.walkthroughs.tensors          # PPO in one file, on tensors that stay on their device

The scripts consist of `# %%` cells. VS Code, Spyder and Jupyter (with jupytext) open them as notebooks. All code is at
the top level: importing a script runs it. With `--quick` each takes seconds and learns almost nothing. Results go to
experiments/results/walkthroughs in the working directory.
"""

__all__: tuple[str, ...] = ()  # tools that import listed modules would run them
