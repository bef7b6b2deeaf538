"""Tube-based nonlinear MPC for the MIRTE Master mecanum robot, as Drake systems."""

__version__ = "0.1.0"
