"""Random tasks in space by seed and kind."""
