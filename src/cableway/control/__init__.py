"""Controllers: from an observation and a plan to a gripper action."""
