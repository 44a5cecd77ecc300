"""The simulation seen through the laboratory's camera and PIV."""
