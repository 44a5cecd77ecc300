"""Stage mesh: planforms and how they follow the motion."""
