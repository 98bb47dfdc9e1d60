"""The experiments of Lee, Nishino and Nobuhara (2025), with their baselines."""

import os

# Before NumPy is loaded: tasks run side by side, and CPU times are those of one core.
os.environ.setdefault("OMP_NUM_THREADS", "1")
