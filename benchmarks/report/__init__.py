"""Size of a report, what it costs to make, and how long a browser takes to open it."""
