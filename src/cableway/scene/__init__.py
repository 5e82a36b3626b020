"""What a task consists of: cable, obstacles, scene, start and goal; and the files that describe it."""
