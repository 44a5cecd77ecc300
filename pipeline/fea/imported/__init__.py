"""The user's own finite-element results or digitised profiles."""
