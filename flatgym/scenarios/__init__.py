"""What is flown: scenarios, distributions of them, disturbances, and the best-known solutions."""
