"""Displacement fields of image pairs by correlation."""
