"""The page: viser's server behind a guard, the scene, the panels, and a page for every connection."""
