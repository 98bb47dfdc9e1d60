"""From images to poses: estimators, their weights, and persons followed from image to image."""
