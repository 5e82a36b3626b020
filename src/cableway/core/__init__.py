"""What everything rests on: errors, checks, configurations, files, compiled code, processes."""
