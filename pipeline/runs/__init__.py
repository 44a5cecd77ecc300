"""Runs: a scene at a level with overrides, what its stages need, and their results."""
