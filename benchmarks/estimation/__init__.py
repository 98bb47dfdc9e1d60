"""Poses from pictures: following persons, and the node that estimates them live."""
