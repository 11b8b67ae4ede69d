"""How each agent of the benchmark is trained or built."""
