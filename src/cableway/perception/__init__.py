"""From pictures of a cable to observations: calibrated cameras, segmentation, centre lines, markers, trackers."""
