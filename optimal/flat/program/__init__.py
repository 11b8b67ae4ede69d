"""Eq. (10) on a grid as a nonlinear program: its transcription, its parameters and bounds, and its solver."""
