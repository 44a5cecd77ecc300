"""The twin of a real finger: its rubber and damping from a film and its pressure."""
