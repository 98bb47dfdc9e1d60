"""How good and how fast the calibration is, measured.

Every benchmark runs on one BLAS thread, so that CPU seconds compare; import this package first.
"""

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
