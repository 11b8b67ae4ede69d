"""Direct multiple shooting over windings and initial guesses."""
