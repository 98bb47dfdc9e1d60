"""The experiments of Lee, Nishino and Nobuhara (2025), with everything that they compare."""
