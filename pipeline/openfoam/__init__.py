"""OpenFOAM's files and programs."""
