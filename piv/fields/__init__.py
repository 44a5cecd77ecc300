"""What follows from vector fields: summaries, statistics over time, derived fields, samples along lines, spectra."""
