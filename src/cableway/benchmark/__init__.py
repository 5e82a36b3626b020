"""The benchmark: frozen suites of tasks, methods as plug-ins, and what is measured of them."""
