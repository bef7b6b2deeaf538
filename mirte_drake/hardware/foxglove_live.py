"""Shows what is driven in Foxglove while it is driven, over a websocket."""

from collections.abc import Iterable
from typing import Self

from mirte_drake.errors import UserError
from mirte_drake.hardware.ros2_messages import Encoded, Ros2Messages

HOST, PORT = "127.0.0.1", 8765  # Where Foxglove looks if not told otherwise.


class FoxgloveLive:
    """A websocket server that Foxglove connects to, on this machine only unless told otherwise.

    It has threads of its own, outside Python, and drops messages for viewers that are too slow.

    Attributes:
        port: Where it listens.
    """

    def __init__(self, messages: Ros2Messages, *, host: str = HOST, port: int = PORT) -> None:
        """Starts the server.

        Args:
            messages: Whose topics are shown.
            host: Address to listen on.
            port: Port to listen on; 0: any that is free.

        Raises:
            UserError: when the package foxglove-sdk is not installed or the port is taken.
        """
        try:
            import foxglove
        except ImportError:
            raise UserError(
                "needs the package foxglove-sdk: pip install mirte-drake[foxglove]"
            ) from None
        self._context = foxglove.Context()  # Channels end with it.
        self._channels = {}
        for topic, kind in messages.topics.items():
            schema = foxglove.Schema(
                name=kind, encoding="ros2msg", data=messages.definition(kind).encode()
            )
            self._channels[topic] = foxglove.Channel(
                topic, schema=schema, message_encoding="cdr", context=self._context
            )
        try:
            self._server = foxglove.start_server(
                name="mirte_drake", host=host, port=port, context=self._context
            )
        except (OSError, RuntimeError) as error:
            raise UserError(f"{host}:{port}: nothing can listen there: {error}") from None
        self.port = self._server.port

    def write(self, encoded: Iterable[Encoded]) -> None:
        """Shows messages to who is connected; never blocks."""
        for topic, time, data in encoded:
            self._channels[topic].log(data, log_time=time)

    def close(self) -> None:
        """Ends the server."""
        self._server.stop()

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes it."""
        self.close()
