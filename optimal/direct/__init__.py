"""Direct multiple shooting: all windings, several initial guesses, certified limits."""
