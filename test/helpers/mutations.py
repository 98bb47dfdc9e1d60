"""Damage to bytes, as a disk, a cable or an attacker does it."""

from __future__ import annotations

import random

WORDS = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FC00000, 0x7F800000, 10**8, 1 << 16)
LONG_WORDS = (0, 1, 1 << 32, 1 << 40, 1 << 63, (1 << 64) - 1)


def mutated(content: bytes, rng: random.Random) -> bytes:
    """Some bytes changed, exchanged, left out, repeated or put in."""
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        if not out:
            break
        kind, at = rng.randrange(8), rng.randrange(len(out))
        if kind == 0:
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            out[at] = rng.randrange(256)
        elif kind == 2:
            out[at : at + 4] = rng.choice(WORDS).to_bytes(4, "little")
        elif kind == 3:
            out[at : at + 8] = rng.choice(LONG_WORDS).to_bytes(8, "little")
        elif kind == 4:
            del out[at : at + rng.randrange(1, 64)]
        elif kind == 5:
            out[at:at] = rng.randbytes(rng.randrange(1, 32))
        elif kind == 6:
            other, n = rng.randrange(len(out)), rng.randrange(1, 256)
            out[at : at + n] = out[other : other + n]
        else:
            del out[at:]
    return bytes(out)
