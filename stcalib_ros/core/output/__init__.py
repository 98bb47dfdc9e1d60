"""From an adjustment to a `Calibration`: unit, gravity, frames."""
