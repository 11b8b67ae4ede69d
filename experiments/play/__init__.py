"""Flight by keyboard or gamepad, against the best-known flight."""
