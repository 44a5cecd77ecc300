"""Pictures and films of vector fields."""
