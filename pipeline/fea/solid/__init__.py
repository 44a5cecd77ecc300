"""The whole finger in 3-D by CalculiX."""
