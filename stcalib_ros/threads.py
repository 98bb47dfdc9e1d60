"""Threads of the linear algebra behind NumPy.

Its products here are small. Spread over the threads of a machine that has other work they wait for
one another, at many times the CPU time; on a quiet machine they take as long with one thread.

Nothing here may import NumPy, which reads these variables when it is first imported.
"""

from __future__ import annotations

import os

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Let NumPy use one thread in this process and those it starts, unless the user says else.

    Without effect on this process once NumPy is imported.
    """
    for name in _VARIABLES:
        os.environ.setdefault(name, "1")
