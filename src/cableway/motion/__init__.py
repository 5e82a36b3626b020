"""The space of the held cable: where it may be, what a shape costs, and how it moves from one to another."""
