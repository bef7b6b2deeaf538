"""The scene in Meshcat: what a run, live or recorded, looks like."""
