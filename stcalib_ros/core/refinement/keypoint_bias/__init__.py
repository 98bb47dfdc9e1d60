"""View-dependent keypoint bias."""
