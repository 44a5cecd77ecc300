"""Comparison of a simulation with a laboratory's DPIV."""
