"""Deformation models: how the cable moves when the grippers move."""
