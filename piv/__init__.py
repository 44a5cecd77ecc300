"""PIV, synthetic recordings and vortex identification; stands alone."""
