"""Neural model predictive control."""
