"""Figures, drawn from numbers alone."""
