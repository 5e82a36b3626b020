"""Ways through the obstacles: pivot path, passages, homotopy classes, infeasibility."""
