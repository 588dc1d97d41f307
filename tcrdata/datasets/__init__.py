"""Dataset adapters, one a file: frames, points, images, ground truth."""
