"""The task for many vehicles at once, compiled: step, hoops, outcome, reward, observation and autoreset in one pass.

The truth is `flatgym.task`; this is the same, written for speed, and tests hold both together. The phases of a step
(`flight`, `worth`, `sight`) are loops over blocks of vehicles without branches; what is rare - a hoop, a floor, the
beginning of an episode - is looked at one vehicle at a time (`events`, `beginning`). `passes` joins them.
"""
