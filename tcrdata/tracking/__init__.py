"""Objects followed over time: short range, the library of trajectories, and long range."""
