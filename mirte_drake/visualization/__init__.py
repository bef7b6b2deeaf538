"""Pictures: figures of a run, and the picture of a Diagram."""
