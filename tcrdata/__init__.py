"""Trusted 3D labels from unlabelled video: every candidate is a row, every check is SQL."""

__version__ = "0.1.0"
