"""Rotations, rigid motions, lenses, triangulation: no cameras of ours."""
