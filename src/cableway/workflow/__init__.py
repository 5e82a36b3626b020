"""One run: planning, rehearsal, tracking, recovery, insertion, verification, report."""
