"""What a laboratory gives: dpiv.toml, pictures, vectors."""
