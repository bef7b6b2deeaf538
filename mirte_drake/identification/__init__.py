"""Offline: from a recording to a model and a disturbance set."""
