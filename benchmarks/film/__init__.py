"""A film of our own: people who walk in a room, seen by cameras that are known exactly."""
