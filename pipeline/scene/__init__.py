"""scene.toml: its sections, checks and levels."""
