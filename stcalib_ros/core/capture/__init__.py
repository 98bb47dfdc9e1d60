"""People by cameras that are calibrated: nothing is solved again."""
