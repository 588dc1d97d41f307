"""Label formats, one a file."""
