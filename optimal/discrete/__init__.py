"""Fewest environment steps K*: controls held for dt, tolerance at the goal.

program         the program of K steps
fixed_steps     a flight in a given number of steps, verified by replay
fewest_steps    the search for the fewest steps
step_bound      the proof that fewer steps are impossible
replanning      the fewest steps from any state
"""
