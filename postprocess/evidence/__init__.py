"""What is compared: planes, vortices and what follows from them."""
