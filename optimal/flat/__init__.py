"""The flat method, equations (8) and (10) of the paper.

splines             spline spaces of the unknowns: weights p_i(s) and squared path speed b(s)
bernstein           proven bounds of piecewise polynomials
bounds              proven bounds of thrust, rate and position of a flat motion
trajectory          the motion in time: eqs. (6), (7), (9)
limits              violation of limits in continuous time, and uniform time scaling
problem             values: the problem, an iterate, a trust region, and the checks at which limits are imposed
program/            eq. (10) as a nonlinear program: transcription, parameters and bounds, one solve on a grid
initial_guess       the slow start of section II-E, and the first solution
projection          a start from any flight
solution            the result, with its status
refinement          mesh refinement and constraint tightening until limits hold in continuous time
planning            `plan`: eq. (10)
following           `follow`: eq. (8)
moving_corridor     corridors around a flight, each around the flight found in the one before
search              the flat method for a scenario: a start in each class of flights
"""
