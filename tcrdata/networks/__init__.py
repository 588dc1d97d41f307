"""Torch modules alone, with what turns points and boxes into their inputs and targets, and back.

A detector, segmenter or flow network is a module of this package with `KIND`, `Settings` and
`make_network()`.
Lengths are metres of a road scene: who calls divides by the sequence's metric scale.
"""
