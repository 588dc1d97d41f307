"""Transforms, boxes and cameras: pure functions of arrays."""
