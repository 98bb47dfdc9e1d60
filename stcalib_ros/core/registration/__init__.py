"""Pairwise registration of two cameras."""
