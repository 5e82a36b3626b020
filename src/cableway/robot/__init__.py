"""Arms that hold the grippers, and what drives them."""
