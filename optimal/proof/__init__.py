"""The lower bound of the flight time: duality, a dynamic programme over the tilt, and branch and bound.

rounding               constants of the error analysis
time_grid              instants and angles of the dynamic programmes
branches               classes of flights, and whether they cover all flights
tilt_program           a proven bound of the integral of q . a: theorem, proof and dynamic programme
zero_order_hold        the tilt programme for controls that are held over environment steps
stations               start, hoops and goal, and the windows of the passing times
chain                  the bound for flights through hoops at unknown times: theorem, proof and dynamic programme
dual                   the dual function F(y), whose negative values exclude a flight time
bundle_method          search for multipliers y with F(y) < 0
initial_multipliers    multipliers from the costates of a direct solution
stages                 exclusion of one branch on grids from coarse to fine
branch_and_bound       exclusion of one flight time, over all branches
lower_bound            `prove`, `lower_bound`, and the proof that can be checked again
files                  proofs on disk
"""
