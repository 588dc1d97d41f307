"""Assembles the HTML report of a selection from queries, rules, scores and pictures."""
