"""A campaign of faults against the drive over a wire: what must happen, and what does."""
