"""Records what is driven to an mcap bag of ROS 2, whatever the wire."""

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from mirte_drake.errors import UserError
from mirte_drake.hardware.ros2_messages import Encoded, Ros2Messages

# [bytes] About what one sample of a drive takes. Each time, a chunk of the file is completed.
CHUNK = 4096


class BagRecorder:
    """Writes a bag that Foxglove, PlotJuggler, `ros2 bag` and `mirte-drake identify` read.

    While it records, the file is called NAME.partial.mcap; it gets its name when it is closed. A
    partial file of a process that was killed holds all but the last chunk, which is about one
    sample; it lacks its index: `pymcap-cli recover` (PyPI) or `mcap recover` mends it. What the
    operating system has not yet brought to the disk is lost where the power fails.
    """

    def __init__(self, path: Path, messages: Ros2Messages) -> None:
        """Begins the bag.

        Args:
            path: File to write, .mcap; its folder is made when missing.
            messages: Whose topics are recorded.

        Raises:
            UserError: when the package mcap is not installed or the file cannot be written.
        """
        try:
            from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
            from mcap.writer import CompressionType, Writer
        except ImportError:
            raise UserError("needs the package mcap: pip install mirte-drake[bags]") from None
        self._path = path
        self._partial = path.with_suffix(f".partial{path.suffix}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._partial.open("wb")
        except OSError as error:
            raise UserError(f"{path}: cannot be written: {error.strerror}") from None
        self._writer = Writer(
            self._file,
            chunk_size=CHUNK,
            compression=CompressionType.NONE,
            use_summary_offsets=False,  # Some would be of nothing, which checkers call an error.
        )
        self._writer.start(profile=Profile.ROS2, library="mirte_drake")
        schemas = {
            kind: self._writer.register_schema(
                kind, SchemaEncoding.ROS2, messages.definition(kind).encode()
            )
            for kind in sorted(set(messages.topics.values()))
        }
        self._channels = {
            topic: self._writer.register_channel(topic, MessageEncoding.CDR, schemas[kind])
            for topic, kind in messages.topics.items()
        }

    def write(self, encoded: Iterable[Encoded]) -> None:
        """Adds messages; the file then has all chunks that are complete.

        Raises:
            OSError: when the file cannot be written, as on a full disk.
        """
        for topic, time, data in encoded:
            self._writer.add_message(self._channels[topic], time, data, publish_time=time)
        self._file.flush()

    def close(self) -> None:
        """Completes the bag and gives it its name; a second call does nothing.

        Raises:
            OSError: when the file cannot be written, as on a full disk.
        """
        if self._file.closed:
            return
        self._writer.finish()
        self._file.close()
        self._partial.replace(self._path)

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes it; what came before an error is worth keeping most of all."""
        self.close()
