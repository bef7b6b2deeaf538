"""The controller's parts as Drake systems: one LeafSystem, its config and its AddX per file."""
