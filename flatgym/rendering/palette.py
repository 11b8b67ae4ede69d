"""The colours of the pictures, red, green and blue: a pale paper, and few strong colours that each mean one thing."""

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
"""Hoops: the one to be passed next, those after it, those passed."""
OUTCOME = {"flying": (71, 85, 105), "goal": GOAL, "time-limit": (180, 120, 10)}
"""Of the words for how a flight stands; the others are failures."""
FAILURE = (200, 40, 50)
