"""Synthetic recordings whose displacement is known."""
