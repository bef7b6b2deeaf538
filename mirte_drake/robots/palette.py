"""Colours of the robot and its floor: red, green, blue, opacity."""

ORANGE = [0.93, 0.42, 0.13, 1.0]
WHITE = [0.93, 0.93, 0.91, 1.0]
DARK = [0.13, 0.14, 0.16, 1.0]
METAL = [0.62, 0.64, 0.67, 1.0]
RUBBER = [0.72, 0.73, 0.74, 1.0]
LIGHT = [1.0, 0.95, 0.75, 1.0]
GLASS = [0.10, 0.35, 0.55, 1.0]
FLOOR = [0.80, 0.81, 0.80, 1.0]
PATCH = [0.55, 0.75, 0.88, 1.0]
