"""What crosses the wire between controller, guard and robot; imported on demand."""
