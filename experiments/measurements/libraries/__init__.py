"""Measurements of the task over PyTorch and JAX: speed beside the compiled kernels, and agreement with NumPy."""
