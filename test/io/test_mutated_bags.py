"""Damaged bags of every storage: an `InputError` of one line, or a recording; nothing else.

``corpus/`` holds small bags that lie about their sizes, or once ended otherwise.
"""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import bag_helpers as bags
import pytest
import zstandard
from bag_storages import rewritten, sqlite
from mcap.writer import CompressionType
from mutations import mutated

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag import read_bag

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())
MUTANTS = 80
"""Of each kind: a second or two."""
MAX_BYTES = 450e6
"""Bytes, at most: an unpacked chunk and the packed one."""


def packed(path: Path) -> Path:
    target = path.with_suffix(".zstd")
    target.write_bytes(zstandard.ZstdCompressor().compress(path.read_bytes()))
    return target


KINDS: dict[str, Callable[[Path, Path], Path]] = {
    "mcap": lambda bag, _: bag,
    "plain mcap": lambda bag, to: rewritten(
        bag, to, compression=CompressionType.NONE, enable_crcs=False
    ),
    "mcap without chunks": lambda bag, to: rewritten(
        bag, to, use_chunking=False, enable_crcs=False
    ),
    "lz4": lambda bag, to: rewritten(bag, to, compression=CompressionType.LZ4, enable_crcs=False),
    "packed messages": lambda bag, to: rewritten(
        bag,
        to,
        pack=zstandard.ZstdCompressor().compress,
        compression=CompressionType.NONE,
        enable_crcs=False,
    ),
    "sqlite": lambda bag, to: sqlite(bag, to, definitions=False, pack=bytes),
    "packed sqlite": lambda bag, to: packed(sqlite(bag, to, definitions=True, pack=bytes)),
}


def read(path: Path) -> bool:
    """Whether a bag can be read."""
    text = ""
    try:
        read_bag(path, warn=lambda _: None)
    except InputError as error:
        text = str(error)
    assert len(text.splitlines()) <= 1
    return not text


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_bag_is_read_or_refused(tmp_path: Path, kind: str) -> None:
    bag = bags.write_bag(tmp_path / "bag.mcap", [*bags.camera("cam0"), *bags.camera("cam1")])
    path = KINDS[kind](bag, tmp_path / "other")
    content, rng = path.read_bytes(), random.Random(kind)
    assert read(path)
    n_read = 0
    tracemalloc.start()
    for _ in range(MUTANTS):
        (tmp_path / "mutant").write_bytes(mutated(content, rng))
        n_read += read(tmp_path / "mutant")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert n_read < MUTANTS
    assert peak < MAX_BYTES


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_the_corpus_is_read_or_refused(path: Path) -> None:
    tracemalloc.start()
    read(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MAX_BYTES
