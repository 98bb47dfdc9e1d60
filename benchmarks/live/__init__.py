"""The live nodes under load."""
