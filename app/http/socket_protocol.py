"""uvicorn's WebSocket protocol, without complaints about sockets that a stop leaves unopened."""

from __future__ import annotations

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol


class SocketProtocol(WebSocketsSansIOProtocol):
    """Protocol of one socket."""

    def shutdown(self) -> None:
        """Close the socket; refuse it if the application has not accepted it yet."""
        refused = not self.handshake_complete
        super().shutdown()
        if refused:
            # uvicorn notes this only in the loop's next turn. An application that returns before
            # would be reported as faulty, and the socket refused once more, which fails.
            self.handshake_complete = self.disconnected = True
