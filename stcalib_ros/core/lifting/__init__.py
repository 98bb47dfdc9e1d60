"""From monocular poses to the metric frame of each camera."""
