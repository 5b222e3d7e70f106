"""Files and single messages that rosbag2 compressed by zstd, beside the chunks of MCAP."""

import zstandard

from .definitions import Undecodable

MAGIC = b"\x28\xb5\x2f\xfd"


def is_packed(data):
    """Tells whether bytes are a frame of zstd; a message in CDR begins with a zero instead."""
    return bytes(data[:4]) == MAGIC


def unpack(data):
    """Decompresses a message; raises Undecodable."""
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError as error:
        raise Undecodable(f"its compression is damaged: {error}") from error


def unpack_file(path, unpacked):
    """Decompresses a file into another as far as possible; returns notes on the rest."""
    with open(path, "rb") as source, open(unpacked, "wb") as target:
        try:
            zstandard.ZstdDecompressor().copy_stream(source, target)
        except zstandard.ZstdError as error:
            return [f"{path}: damaged: {error}"]
    return []
