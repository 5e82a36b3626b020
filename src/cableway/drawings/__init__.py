"""Outlines from elsewhere: drawings in SVG and DXF, split into convex obstacles."""
