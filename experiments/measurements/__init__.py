"""Is it fast, and is it right? Benchmarks of environments, solvers, proofs and demonstrations."""
