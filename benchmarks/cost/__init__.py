"""CPU time and memory."""
