"""How a simulated plant differs from its task: cable, grasp, sensing, start, obstacles.

A `Perturbation` says it, whether made in Python, drawn by name (`variants`) or read from a YAML file (`reading`).
"""
