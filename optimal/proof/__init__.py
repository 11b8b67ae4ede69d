"""The lower bound: a dual dynamic programme over the tilt, with branch and bound."""
