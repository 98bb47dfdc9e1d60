"""The configuration file that we ship says what there is, and the defaults that hold."""

from __future__ import annotations

import json
from dataclasses import asdict

import yaml

from stcalib_ros.core.options import Options
from stcalib_ros.io.config import Config, read_config


def test_it_has_every_option_with_its_default(root):
    content = yaml.safe_load((root / "config/calibrate.yaml").read_text())
    assert content == json.loads(json.dumps(asdict(Options())))


def test_it_changes_nothing(root):
    assert read_config(root / "config/calibrate.yaml") == Config()
