"""Random tasks: a seed and a kind make a task, and for solvable kinds a motion that solves it."""
