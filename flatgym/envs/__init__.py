"""The Gymnasium environments, scalar and batched, over one fleet."""
