"""Recordings by the program or camera that wrote them."""
