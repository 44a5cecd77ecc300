"""The laboratory's finger found in its pictures."""
