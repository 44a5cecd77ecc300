"""The swept mesh: planform, cells, volumes and quality."""
