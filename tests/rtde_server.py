"""A stand-in for the controller of an arm: speaks RTDE, protocol version 2, in a process of its own.

    python rtde_server.py ADDRESS

says "ready" when it listens on port 30004, then reads lines of JSON: new values of its variables by name, or
{"answer": false} to fall silent, {"close": true} to drop its connections, {"accept": false} to refuse every request,
{"start": false} to refuse to send data.
"""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import sys
import threading
import time
from typing import Any

PORT = 30004
HEADER = struct.Struct(">HB")
REQUEST_PROTOCOL_VERSION, GET_URCONTROL_VERSION = ord("V"), ord("v")
SETUP_OUTPUTS, START, PAUSE, DATA = ord("O"), ord("S"), ord("P"), ord("U")
FORMATS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i", "UINT32": "I", "UINT64": "Q"}
TYPES = {
    "timestamp": "DOUBLE", "actual_q": "VECTOR6D", "actual_qd": "VECTOR6D", "robot_mode": "INT32",
    "safety_mode": "INT32", "safety_status_bits": "UINT32", "robot_status_bits": "UINT32", "runtime_state": "UINT32",
    "output_int_register_2": "INT32", "output_int_register_12": "INT32",
}  # fmt: skip


class Controller:
    """The values of an arm, and who is told."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = dict.fromkeys(TYPES, 0)
        self.values |= {"actual_q": [0.0] * 6, "actual_qd": [0.0] * 6, "robot_mode": 7, "safety_mode": 1}
        self.values |= {"safety_status_bits": 1, "robot_status_bits": 3, "runtime_state": 2}
        self.answer = self.accept = self.start = True
        self.clients: list[socket.socket] = []
        self.lock, self.begun = threading.Lock(), time.monotonic()

    def told(self, changes: dict[str, Any]) -> None:
        with self.lock:
            self.answer, self.accept = changes.pop("answer", self.answer), changes.pop("accept", self.accept)
            self.start = changes.pop("start", self.start)
            if changes.pop("close", False):
                for client in self.clients:
                    with contextlib.suppress(OSError):
                        client.shutdown(socket.SHUT_RDWR)
            assert set(changes) <= set(TYPES)
            self.values |= changes

    def serve(self, client: socket.socket) -> None:
        """Answer the requests of a client until it goes."""
        recipe: list[str] = []
        period, started = 0.002, threading.Event()
        with client, contextlib.suppress(OSError, EOFError):
            while True:
                size, kind = HEADER.unpack(exactly(client, HEADER.size))
                payload = exactly(client, size - HEADER.size)
                if not self.answer:
                    continue
                ok = struct.pack(">B", self.accept)
                if kind == REQUEST_PROTOCOL_VERSION:
                    assert struct.unpack(">H", payload) == (2,)
                    send(client, kind, ok)
                elif kind == GET_URCONTROL_VERSION:
                    send(client, kind, struct.pack(">4I", 5, 12, 0, 0))
                elif kind == SETUP_OUTPUTS:
                    (rate,) = struct.unpack_from(">d", payload)
                    period, recipe = 1 / rate, [name for name in payload[8:].decode().split(",") if name]
                    kinds = ",".join(TYPES.get(name, "NOT_FOUND") for name in recipe)
                    send(client, kind, struct.pack(">B", 1) + kinds.encode())
                elif kind in (START, PAUSE):
                    send(client, kind, ok if self.start else b"\0")
                    if kind == START and self.start and not started.is_set():
                        started.set()
                        threading.Thread(target=self.stream, args=(client, recipe, period), daemon=True).start()
                else:
                    raise AssertionError(f"package type {chr(kind)!r}")

    def stream(self, client: socket.socket, recipe: list[str], period: float) -> None:
        """Send data packages until the client goes."""
        with contextlib.suppress(OSError):
            while True:
                with self.lock:
                    values = {**self.values, "timestamp": time.monotonic() - self.begun}
                    answer = self.answer
                data = struct.pack(">B", 1)
                for name in recipe:
                    value = values[name]
                    data += struct.pack(">" + FORMATS[TYPES[name]], *(value if isinstance(value, list) else [value]))
                if answer:
                    send(client, DATA, data)
                time.sleep(period)


def send(client: socket.socket, kind: int, payload: bytes) -> None:
    client.sendall(HEADER.pack(HEADER.size + len(payload), kind) + payload)


def exactly(client: socket.socket, count: int) -> bytes:
    content = b""
    while len(content) < count:
        part = client.recv(count - len(content))
        if not part:
            raise EOFError
        content += part
    return content


def main(address: str) -> None:
    controller = Controller()
    listening = socket.create_server((address, PORT))

    def accept() -> None:
        while True:
            client, _ = listening.accept()
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            controller.clients.append(client)
            threading.Thread(target=controller.serve, args=(client,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        controller.told(json.loads(line))
        print("done", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
