"""A local page in the browser: images and vectors over time, masks, measures, settings to try."""
