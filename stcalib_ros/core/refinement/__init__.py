"""Optional unknowns of the adjustment, estimated at the end."""
