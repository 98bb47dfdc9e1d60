"""How tests are shared out to processes and threads: `make test` runs two processes of one.

Examples of hypothesis are the same in every run.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

from stcalib_ros.threads import use_one_thread

use_one_thread()  # as the commands do: BLAS threads of two processes would wait for each other

settings.register_profile("seeded", derandomize=True)
settings.load_profile("seeded")  # other examples: pytest --hypothesis-profile default

HERE = Path(__file__).parent
ON_THE_NETWORK = ("ros", "packaging")
"""Folders whose tests are one group: nodes of two tests would meet, and builds share a folder."""


def pytest_itemcollected(item: pytest.Item) -> None:
    """Keep a file's tests in one process, for what they share is then made once."""
    place = item.path.relative_to(HERE)
    group = "ros" if place.parts[0] in ON_THE_NETWORK else str(place)
    item.add_marker(pytest.mark.xdist_group(group))
