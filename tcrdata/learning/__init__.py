"""Learning from a store: samples by SQL, augmentation, one training loop, checkpoints."""
