"""The colours of the pictures as RGB: a pale background and few strong colours, each with one meaning."""

PAPER = (248, 250, 252)
WHITE = (255, 255, 255)
INK = (30, 41, 59)
FAINT = (148, 163, 184)
PALE = (226, 232, 240)
GRID, GRID_MAIN = (234, 239, 244), (214, 222, 231)
BAND, HATCH = (228, 234, 240), (205, 214, 224)
GHOST = (84, 110, 150)
ROTOR = (100, 116, 139)
GOAL = (22, 148, 84)
NEXT, AHEAD, PASSED = (37, 99, 235), (125, 138, 158), (110, 186, 146)
"""Colours of hoops: the next one, later ones, passed ones."""
OUTCOME = {"flying": (71, 85, 105), "goal": GOAL, "time-limit": (180, 120, 10)}
"""Colours of outcomes; all others are failures."""
FAILURE = (200, 40, 50)
