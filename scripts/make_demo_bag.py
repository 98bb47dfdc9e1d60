#!/usr/bin/env python3
"""Make the demo bag again from its source, balance_multi_blazepose.npz.

    python scripts/make_demo_bag.py balance_multi_blazepose.npz

writes balance.mcap and balance_truth.yaml into stcalib_ros/data/demo (or --output FOLDER).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.convert import convert_npz
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.results import write_result

DEMO = Path(__file__).parent.parent / "stcalib_ros" / "data" / "demo"
CLOCK_SHIFTS_S = {"cam01": 0.0, "cam02": 0.317, "cam03": -0.210, "cam04": 0.143}


def main() -> None:
    """Write the bag and its truth file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("source", type=Path, help="balance_multi_blazepose.npz")
    parser.add_argument("--output", type=Path, default=DEMO, metavar="FOLDER")
    args = parser.parse_args()
    recording, truth = convert_npz(args.source, ConvertOptions(clock_shifts_s=CLOCK_SHIFTS_S))
    write_bag(recording, args.output / "balance.mcap")
    write_result(truth, args.output / "balance_truth.yaml")


if __name__ == "__main__":
    main()
