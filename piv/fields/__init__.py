"""Quantities of vector fields: summaries, statistics, derived fields, lines, spectra."""
