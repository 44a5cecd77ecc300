"""A local page in the browser: images and vectors over time, numbers of a vector, masks and regions that `correlate` reads."""
