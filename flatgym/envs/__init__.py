"""The Gymnasium environments, scalar and batched: thin shells around a fleet of n vehicles."""
