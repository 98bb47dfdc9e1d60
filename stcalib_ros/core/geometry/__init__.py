"""Rotations, rigid motions, lenses, triangulation, graphs, splines: pure functions of arrays."""
