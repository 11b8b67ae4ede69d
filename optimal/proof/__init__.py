"""The lower bound of the flight time: duality, dynamic programmes over the tilt, and branch and bound.

programme              the bound for given multipliers: tilts, held controls, chains of hoops
branches               classes of flights, and whether they cover all flights
chain_terms            the terms of all chains for given multipliers, and their rounding error
dual                   the dual function F(y), whose negative values exclude a flight time
bundle_method          search for multipliers y with F(y) < 0
initial_multipliers    multipliers from the costates of a direct solution
stages                 the exclusion of one branch, as a proof stores it, and its check
exclusion              the search for it, on grids from coarse to fine
branch_and_bound       exclusion of one flight time, over all branches
lower_bound            `prove`, `lower_bound`, and the proof that can be checked again
files                  proofs on disk
"""
