"""Calibration of camera extrinsics, clock offsets and identities from people walking.

Implements Lee, Nishino and Nobuhara, "Spatiotemporal Multi-Camera Calibration
using Freely Moving People" (2025), for ROS 2 and without it.
"""

from pkgutil import extend_path

# In a ROS 2 workspace the generated messages live in another folder of the same package.
__path__ = extend_path(__path__, __name__)

__version__ = "0.1.0"
