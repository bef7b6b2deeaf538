"""The mathematics of the controller, on arrays."""
