"""Plane geometry: rigid motions, polylines, convex shapes and signed distance. Arrays in, arrays out."""
