"""Bending states of the finger by finite elements: run (FElupe or CalculiX), import, write `states.h5`."""
