"""Asks a store and its rules: why a proposal became what it is, what the rules decide."""
