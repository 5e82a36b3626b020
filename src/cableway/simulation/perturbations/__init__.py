"""How a simulated plant differs from the task: cable, grasp, sensing."""
