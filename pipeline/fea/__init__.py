"""Bending states of the finger by finite elements: compute, import, write `states.h5`."""
