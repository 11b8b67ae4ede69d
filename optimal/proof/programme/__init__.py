"""Dynamic programmes that bound an integral of the acceleration over all flights, for given multipliers.

rounding           constants of the error analysis
time_grid          instants and angles
tilt_program       the bound of the integral of q . a: theorem, proof and dynamic programme
zero_order_hold    the same for controls that are held over environment steps
stations           start, hoops and goal, and what is known of the passing times
chain              the bound for flights through hoops at unknown times: theorem, proof and dynamic programme
point_mass         pairs of passing times that a chain need not consider
"""
