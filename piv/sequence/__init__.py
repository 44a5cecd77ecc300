"""Whole recordings: field by field, several frames at once, ensembles, chunks."""
