"""Cues, one a file: each measures numbers and decides nothing."""
