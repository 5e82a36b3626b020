"""Arms: kinematics, distances of their links, and how two of them follow the grippers of a plan."""
