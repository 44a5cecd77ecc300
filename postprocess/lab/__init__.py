"""Comparison with a laboratory's DPIV: registration, virtual experiment, uncertainty, verdict, report."""
