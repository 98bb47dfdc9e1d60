"""Spread the pairs of many cameras over a Dask cluster.

    pip install distributed
    python examples/dask_cluster.py walk.mcap walk.yaml                        # this machine
    python examples/dask_cluster.py walk.mcap walk.yaml tcp://scheduler:8786   # a cluster

The workers need stcalib_ros. The result is identical, to the last bit, to that without a cluster;
the same holds for any other `concurrent.futures.Executor`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from distributed import Client

import stcalib_ros as st


def main() -> None:
    """Calibrate a bag."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("bag", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("scheduler", nargs="?", help="address (default: start workers here)")
    args = parser.parse_args()
    recording = st.read_bag(args.bag)
    with Client(args.scheduler) as client:
        calibration = st.calibrate(recording, executor=client.get_executor())
    print(f"{calibration.status.name}: {calibration.message}")
    if calibration.cameras:
        st.write_result(calibration, args.output)


if __name__ == "__main__":
    main()
