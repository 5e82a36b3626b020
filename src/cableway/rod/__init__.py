"""The elastic rod clamped at both ends, in the plane and in space: equilibria, stability, inverse problems."""
