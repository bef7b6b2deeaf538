"""What the robot does: pure functions and value types, no Drake systems."""
