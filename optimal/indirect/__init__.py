"""The indirect method: Pontryagin's conditions as a boundary-value problem.

costates        costates of a direct solution: Hamiltonian and switching functions along it
arcs            switching structure, read from a direct solution
extremal        closed-form bang and singular arcs, and the flight they form
conditions      the boundary-value problem of a switching structure, in CasADi
verification    sign conditions of a solved flight, and the structure they ask for
pontryagin      search over structures: `pontryagin`, and `fastest` over windings
"""
