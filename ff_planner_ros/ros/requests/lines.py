"""The two connections between the node and the process that makes a plan."""

from __future__ import annotations

import select
import socket
from contextlib import suppress

# While a plan is made, whether it is still wanted is asked so often [s].
POLL = 0.02
# What is read of the stream at once [bytes].
_CHUNK = 1 << 20


class Lines:
    """Packets, which tell how far a plan is, and a stream: the request goes out, the answer in."""

    def __init__(self, request: bytes) -> None:
        """Connect them; the request goes out during `exchange`."""
        self.packets, self._their_packets = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._stream, self._their_stream = socket.socketpair()
        self._stream.setblocking(False)
        self._outgoing = memoryview(request)
        self.incoming = bytearray()  # what has come in on the stream
        self.is_complete = False  # whether no more will come in on it

    def close(self) -> None:
        """Hang up: the plan ends, if it is still being made."""
        self.leave_theirs()
        self.packets.close()
        self._stream.close()

    @property
    def theirs(self) -> list[int]:
        """Descriptors of the solver's ends."""
        return [self._their_packets.fileno(), self._their_stream.fileno()]

    def leave_theirs(self) -> None:
        """Leave the solver's ends to the solver alone, so that its death is noticed."""
        self._their_packets.close()
        self._their_stream.close()

    def hang_up(self) -> None:
        """End the plan; may be called from any thread while the lines are open."""
        for line in (self.packets, self._stream):
            with suppress(OSError):  # broken by itself just now
                line.shutdown(socket.SHUT_RDWR)

    def exchange(self) -> bool:
        """Wait a moment, write and read what can be; return whether a packet has come in."""
        heard = [self.packets] if self.is_complete else [self.packets, self._stream]
        told = [self._stream] if self._outgoing else []
        readable, writable, _ = select.select(heard, told, [], POLL)
        if writable:
            try:
                self._outgoing = self._outgoing[self._stream.send(self._outgoing) :]
            except OSError:  # nobody reads it any more
                self._outgoing = memoryview(b"")
        if self._stream in readable:
            try:
                chunk = self._stream.recv(_CHUNK)
            except OSError:  # it ended before it had read everything
                chunk = b""
            self.incoming += chunk
            self.is_complete = not chunk
        return self.packets in readable
