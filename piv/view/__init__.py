"""A local page in the browser: images and vectors over time, masks and regions to draw."""
