"""From pictures of a cable without markers to observations: calibrated cameras, segmentation, centre lines, tracker."""
