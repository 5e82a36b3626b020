"""The paper's planning chain: pivot path by RRT*, path set, deformation optimisation."""
