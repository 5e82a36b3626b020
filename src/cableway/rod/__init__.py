"""The planar elastic rod clamped at both ends: equilibria, their stability, and inverse problems."""
