"""``python -m stcalib_ros`` is the command ``stcalib``."""

import sys

from stcalib_ros.cli import main

if __name__ == "__main__":
    sys.exit(main())
