"""Anything with a wheel_command input and a pose output, simulated or real."""
