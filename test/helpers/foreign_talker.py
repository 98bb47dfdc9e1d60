"""A process of its own: publishes a bag, each message by the class of its own package."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from live import Client
from rclpy.serialization import deserialize_message

from stcalib_ros.ros.convert import message_class


def main(target: str, bag: str, counts: str) -> None:
    """Publish until so many images of every camera, in JSON, have arrived."""
    client = Client(target)
    client.play_completely(
        Path(bag),
        json.loads(counts),
        sent=lambda raw: deserialize_message(raw.data, message_class(raw.type_name)),
    )
    client.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
