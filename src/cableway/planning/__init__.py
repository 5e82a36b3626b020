"""Planning: from a task to a verified plan."""
