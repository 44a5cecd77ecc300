"""Many runs: study tables, predictions, batch jobs."""
