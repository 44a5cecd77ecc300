"""Outliers and noise of vector fields."""
