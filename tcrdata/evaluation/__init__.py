"""Scores of labels against ground truth."""
