"""One module per file format: its schema, its reader and its writer."""
