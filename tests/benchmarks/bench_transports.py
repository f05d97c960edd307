"""What a message costs the network's thread on its way out, us of processor time, by transport and readers.

python tests/benchmarks/bench_transports.py
"""

from __future__ import annotations

import asyncio
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

if __name__ == "__main__":
    for room in ("sinks", "contract"):
        sys.path.insert(0, str(Path(__file__).resolve().parent.parent / room))

import msgspec
from network_rig import MESSAGE, plan

from quavelet.sinks.output import Output
from quavelet.sinks.outputs import make_output

MESSAGES = 5_000


async def cost_us(output: Output, connect: Callable[[], socket.socket] | None, readers: int) -> float:
    """Of one message; the readers read between the measured calls."""
    await output.open()
    ends = [connect() for _ in range(readers)] if connect else []
    while output.status().readers < readers:
        await asyncio.sleep(0.001)
    spent_s = 0.0
    for n in range(MESSAGES):
        message = msgspec.structs.replace(MESSAGE, t_ns=n)
        began_s = time.thread_time()
        output.write(message)
        spent_s += time.thread_time() - began_s
        for end in ends:
            end.recv(65_536)
    lost = output.status().lost
    for end in ends:
        end.close()
    await output.close()
    assert lost == 0
    return 1e6 * spent_s / MESSAGES


async def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/x.sock"

        def unix() -> socket.socket:
            sock = socket.socket(socket.AF_UNIX)
            sock.connect(path)
            return sock

        for readers in (0, 1, 8):
            print(f"unix, {readers} readers: {await cost_us(make_output(plan(f'unix:{path}')), unix, readers):.1f} us")
        for readers in (0, 1, 8):
            with socket.socket() as probe:
                probe.bind(("127.0.0.1", 0))
                port = probe.getsockname()[1]

            def tcp(port: int = port) -> socket.socket:
                return socket.create_connection(("127.0.0.1", port))

            output = make_output(plan(f"tcp:127.0.0.1:{port}"))
            print(f"tcp, {readers} readers: {await cost_us(output, tcp, readers):.1f} us")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))
            output = make_output(plan(f"udp:127.0.0.1:{sock.getsockname()[1]}"))
            print(f"udp: {await cost_us(output, None, 0):.1f} us")


if __name__ == "__main__":
    asyncio.run(main())
