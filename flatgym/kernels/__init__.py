"""Compiled kernels: step, events, outcome, reward, observation and autoreset of n vehicles in one pass.

`flatgym.task` defines the task; the kernels repeat it for speed, and tests hold the two together. The phases of a step
(`transition`, `reward`, `observation`) are branch-free loops over blocks of vehicles. Rare work, such as a
contact (`events`) or the start of an episode (`reset`), is done for one vehicle at a time. `step` combines them.
"""
