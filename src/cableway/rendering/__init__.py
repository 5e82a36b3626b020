"""Pictures in perspective without a display or graphics hardware: camera, triangles, rasteriser; and what a cell is."""
