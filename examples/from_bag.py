"""Calibrate the cameras of a bag and save the result.

    python examples/from_bag.py stcalib_ros/data/demo/balance.mcap demo.yaml

The same as ``stcalib calibrate``, as a program of your own to build on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import stcalib_ros as st


def main() -> None:
    """Calibrate a bag."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("bag", type=Path)
    parser.add_argument("output", type=Path)
    args = parser.parse_args()
    calibration = st.calibrate(st.read_bag(args.bag))
    print(f"{calibration.status.name}: {calibration.message}")
    for person in calibration.persons:
        print(f"person {person.person_id}: {dict(person.tracks)}")
    if calibration.status is st.Status.OK:
        st.write_result(calibration, args.output)


if __name__ == "__main__":
    main()
