"""Measurements of accuracy and cost of the calibration.

Importing this package limits BLAS to one thread, for CPU seconds to be comparable; it has to
happen before NumPy is imported.
"""

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
