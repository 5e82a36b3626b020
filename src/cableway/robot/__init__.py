"""Arms that hold the grippers: kinematics, distances of their links, how they follow a plan, and what drives them."""
