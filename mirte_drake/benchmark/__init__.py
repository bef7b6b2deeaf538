"""How long the solvers of the optimal control problem take, and how well they solve it."""
