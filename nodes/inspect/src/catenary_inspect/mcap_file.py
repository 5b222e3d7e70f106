"""One MCAP file, read chunk by chunk from the front, so that a damaged chunk costs only its own messages."""

import struct

from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, DataEnd, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.summary import Summary
from zstandard import ZstdError

MAGIC = b"\x89MCAP0\r\n"
# Errors that the reader and the decompression raise on damaged bytes.
DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, ValueError, LookupError, OverflowError, MemoryError, RuntimeError)


def read(path, source, reading, notes):
    """Gives the messages of `source`, which notes call `path`, to `reading`; returns True if the file is unfinished."""
    with open(source, "rb") as stream:
        file = McapFile(stream, reading)
        file.read()
    missing = [*file.missing()]
    notes += [f"{path}: {'; '.join(missing)}"] if missing else []
    return not file.is_finished


class McapFile:
    """A file that may be damaged.

    `is_finished`: it has a summary. `at_end`: the data were read to their end. `end`: offset up to which the data were read.
    `orphans`: number of messages without a definition of their topic.
    """

    def __init__(self, stream, reading):
        self.stream, self.reading = stream, reading
        self.size, self.end = stream.seek(0, 2), len(MAGIC)
        self.summary = summary(stream, self.size)
        self.is_finished = self.summary.statistics is not None
        self.schemas = dict(self.summary.schemas)
        self.channels, self.damages, self.taken, self.orphans = {}, [], 0, 0
        # Definitions come from the summary, too, because the chunk that holds them may be damaged.
        for channel in self.summary.channels.values():
            self.define(channel)

    def read(self):
        """Takes all readable records."""
        later = [chunk.chunk_start_offset for chunk in self.summary.chunk_indexes]
        start = 0
        while start is not None:
            for record in self.records(start):
                self.take_record(record)
                self.end = self.stream.tell()
            # After a record of wrong length, reading goes on at the next chunk that the summary lists.
            reached, start = self.end, min((at for at in later if at > self.end and not self.at_end), default=None)
            if start is not None:
                self.damages.append(f"damaged from byte {reached} to {start}")
                self.end = start

    def records(self, start):
        """Records from an offset to the end of the data or to a damaged record."""
        self.at_end = False
        self.stream.seek(start)
        reader = StreamReader(self.stream, skip_magic=start > 0, emit_chunks=True, validate_crcs=True, record_size_limit=self.size)
        try:
            for record in reader.records:
                if isinstance(record, DataEnd):
                    self.at_end = True
                    return
                yield record
        except CRCValidationError as error:
            # The checksum of all data stands at their end.
            self.at_end = True
            if not self.damages:
                self.damages.append(f"damaged somewhere: {error}")
        except DAMAGE:
            return

    def take_record(self, record):
        """Takes a record, or all records of a chunk."""
        if not isinstance(record, Chunk):
            self.take(record)
            return
        try:
            if record.compression not in ("", "zstd", "lz4"):
                raise McapError(f"expected compression by zstd or lz4, found {record.compression}")
            records = breakup_chunk(record, validate_crc=True)
        except DAMAGE as error:
            self.damages.append(f"damaged: the chunk at byte {self.end} is lost: {error or repr(error)}")
            return
        for inner in records:
            self.take(inner)

    def take(self, record):
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self.define(record)
        elif isinstance(record, Message):
            if record.channel_id not in self.channels:
                self.orphans += 1
                return
            self.taken += 1
            self.reading.take(*self.channels[record.channel_id], record.log_time, record.data)

    def define(self, channel):
        if channel.id in self.channels:
            return
        schema = self.schemas.get(channel.schema_id)
        type_name = schema.name if schema else ""
        text = schema.data.decode(errors="replace") if schema else ""
        self.channels[channel.id] = (channel.topic, (type_name, channel.message_encoding, schema.encoding if schema else "", text))
        self.reading.define(channel.topic, type_name, channel.metadata.get("offered_qos_profiles", ""))

    def missing(self):
        """Sentences on missing and damaged parts."""
        if not self.is_finished:
            left = 0 if self.at_end else self.size - self.end
            state = "it has no summary" if self.at_end else "not finished"
            yield f"{state}: {self.taken} messages were found" + (f", and nothing in its last {left} bytes" if left else "")
        yield from self.damages
        if self.orphans:
            yield f"{self.orphans} messages are lost with what defined their topics"
        expected = self.summary.statistics.message_count if self.summary.statistics else self.taken
        if expected > self.taken:
            yield f"{expected - self.taken} of its {expected} messages are missing"


def summary(stream, size):
    """Summary at the end of a file; empty if it is missing or damaged."""
    try:
        stream.seek(0)
        return SeekingReader(stream, record_size_limit=size).get_summary() or Summary()
    except (*DAMAGE, OSError):  # OSError: the file is shorter than an end record.
        return Summary()
