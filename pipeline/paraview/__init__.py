"""A run as a time series for ParaView."""
