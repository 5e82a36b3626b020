"""Scenes and tasks in space: what a cable that is lifted goes through, and from where to where."""
