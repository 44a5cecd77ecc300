"""The page of a comparison with a laboratory."""
