"""Pictures and video of tasks, plans and rollouts."""
