"""Stage run: the solver, its guards and its results."""
