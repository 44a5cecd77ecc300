"""Comparison of CFD and PIV, figures and the report."""
