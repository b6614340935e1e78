"""Blocks of numbers in VTK XML: base64 or raw, compressed or not."""

from __future__ import annotations

import base64
import lzma
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsmooth.errors import MeshError

BLOCK = 1 << 15  # bytes that VTK compresses at a time

# Arrays of a file may take so many times its bytes, and some more, and decoding this much beside: a
# few bytes can say that they are gigabytes.
MOST_TIMES, MOST_MORE = 100, 1 << 26


def _inflated(packed: bytes, size: int) -> bytes:
    return zlib.decompressobj().decompress(packed, size)


def _unpacked(packed: bytes, size: int) -> bytes:
    return lzma.LZMADecompressor(memlimit=MOST_MORE + (1 << 23)).decompress(packed, size)


# Compresses bytes; makes so many bytes of compressed ones, or fewer.
Codec = tuple[Callable[[bytes], bytes], Callable[[bytes, int], bytes]]
CODECS: dict[str, Codec] = {
    "vtkZLibDataCompressor": (zlib.compress, _inflated),
    "vtkLZMADataCompressor": (lzma.compress, _unpacked),
}


@dataclass
class Storage:
    """How numbers are stored as bytes in one file."""

    order: str
    header: str
    compressor: str | None
    room: int = 0  # bytes that may still be made of compressed ones

    @property
    def codec(self) -> Codec | None:
        """How blocks are compressed, if they are; a text file may name any compressor."""
        if self.compressor and self.compressor not in CODECS:
            raise MeshError(f"compressor {self.compressor} is not read, only {', '.join(CODECS)}")
        return CODECS[self.compressor] if self.compressor else None

    @property
    def size(self) -> int:
        return np.dtype(self.header).itemsize

    def decode(self, stored: bytes, encoded: bool) -> tuple[bytes, int]:
        """Numbers' bytes of the block that `stored` begins with, and the length of that block."""
        codec = self.codec
        if codec is None:
            (n,) = self.heads(stored, 1, encoded)
            if not encoded:
                return self.cut(stored, self.size, n), self.size + n
            # Some writers encode the header apart, which shows as padding after it.
            apart = -(-self.size // 3) * 4
            if stored[:apart].endswith(b"="):
                return self.unbase64(stored[apart:], n), apart + _base64_length(n)
            return self.unbase64(stored, self.size + n)[self.size :], _base64_length(self.size + n)
        n_blocks = self.heads(stored, 1, encoded)[0]
        if n_blocks > len(stored):
            raise MeshError(f"{n_blocks} compressed blocks: the data is damaged")
        _, whole, rest, *sizes = self.heads(stored, 3 + n_blocks, encoded)
        raw_sizes = [*[whole] * (n_blocks - 1), rest or whole][:n_blocks]
        self.room -= sum(raw_sizes)
        if self.room < 0:
            raise MeshError(
                f"{sum(raw_sizes)} bytes are said to be compressed in it: the data is damaged"
            )
        n, begin = sum(sizes), (3 + n_blocks) * self.size
        if encoded:
            begin = _base64_length(begin)
            packed = self.unbase64(stored[begin:], n)
            length = begin + _base64_length(n)
        else:
            packed, length = self.cut(stored, begin, n), begin + n
        pieces, at = [], 0
        for size, raw_size in zip(sizes, raw_sizes, strict=True):
            pieces.append(codec[1](packed[at : at + size], raw_size))
            if len(pieces[-1]) != raw_size:
                raise MeshError(f"a block has {len(pieces[-1])} bytes, not {raw_size}")
            at += size
        return b"".join(pieces), length

    def encode(self, raw: bytes, encoded: bool) -> bytes:
        """The reverse of `decode`."""
        codec = self.codec
        if codec is None:
            stored = np.array([len(raw)], self.header).tobytes() + raw
            return base64.b64encode(stored) if encoded else stored
        packed = [codec[0](raw[i : i + BLOCK]) for i in range(0, len(raw), BLOCK)]
        heads = [len(packed), BLOCK, len(raw) % BLOCK, *map(len, packed)]
        header = np.array(heads, self.header).tobytes()
        body = b"".join(packed)
        if encoded:
            return base64.b64encode(header) + base64.b64encode(body)
        return header + body

    def heads(self, stored: bytes, n: int, encoded: bool) -> list[int]:
        raw = self.unbase64(stored, n * self.size) if encoded else stored
        return list(map(int, np.frombuffer(self.cut(raw, 0, n * self.size), self.header)))

    def unbase64(self, stored: bytes, n: int) -> bytes:
        raw = base64.b64decode(stored[: _base64_length(n)])
        return self.cut(raw, 0, n)

    def cut(self, raw: bytes, begin: int, n: int) -> bytes:
        if len(raw) < begin + n:
            raise MeshError(f"binary data ends after {len(raw)} of {begin + n} bytes")
        return raw[begin : begin + n]


def _base64_length(n: int) -> int:
    return -(-n // 3) * 4
