"""Flying by keyboard or gamepad."""
