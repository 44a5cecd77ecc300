"""The finger as an elastic chain: what loads do to it."""
