"""Stage solve: the solver, its guards and its results."""
