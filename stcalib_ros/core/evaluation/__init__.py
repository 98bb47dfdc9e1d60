"""Errors against known truth, and their lower bound."""
