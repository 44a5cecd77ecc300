"""Comparison error against uncertainty, and the verdict."""
