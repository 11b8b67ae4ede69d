"""A second checker of saved proofs, written from the theorems in plain NumPy. It shares no code with the prover.

reading    the file as plain data, and whether its branches cover all flights
physics    passing times and speeds that are possible at all, from thrust alone
chains     the stations of a stage, the windows of their passing times, the weights, and the error terms
sweeps     the programme over the tilt, for controls that may change at any time
held       the same for controls that are held over environment steps
checker    the longest path through the stations, and the verdict

The theorems stand in `optimal.proof.programme`. From `flatgym` it takes the scenario and its vehicle.
"""
