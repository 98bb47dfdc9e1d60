"""Spread the pairs of many cameras over a Dask cluster.

    pip install distributed
    python examples/dask_cluster.py walk.mcap walk.yaml                        # this machine
    python examples/dask_cluster.py walk.mcap walk.yaml tcp://scheduler:8786   # a cluster

The workers need stcalib_ros; the result is the same, to the last bit, as without a cluster. So it
is with any other `concurrent.futures.Executor`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from distributed import Client

from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.results import write_result


def main() -> None:
    """Calibrate a bag."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("bag", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("scheduler", nargs="?", help="its address (default: workers started here)")
    args = parser.parse_args()
    recording = read_bag(args.bag)
    with Client(args.scheduler) as client:
        calibration = calibrate(recording, executor=client.get_executor())
    print(f"{calibration.status.name}: {calibration.message}")
    if calibration.cameras:
        write_result(calibration, args.output)


if __name__ == "__main__":
    main()
