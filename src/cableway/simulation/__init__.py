"""The simulated plant (MuJoCo) and data collection from it."""
