"""Coupled runs: pressure and water make the motion together, while the flow is solved."""
