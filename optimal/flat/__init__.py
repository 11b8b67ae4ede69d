"""The paper's method: flat outputs along a path, equations (8) and (10)."""
