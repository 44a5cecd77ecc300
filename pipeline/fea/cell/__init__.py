"""The unit cell of one chamber."""
