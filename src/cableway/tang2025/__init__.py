"""The system of Tang et al. 2025: planning chain, networks and their training, neural MPC, tables and figures."""
