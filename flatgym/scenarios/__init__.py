"""Scenarios, distributions of scenarios, disturbances, and the best-known solutions."""
