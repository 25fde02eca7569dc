"""``python -m benchmarks.app.receiver``: a client of a page that moves its camera, and only receives the pictures.

It reads a JSON object from standard input: `url`, `cameras` (pairs of a quaternion wxyz and a position, in the page's
axes), `fov`, `size`, `rounds`, `seconds` (how long the camera moves in a round) and `patience` (the longest wait for a
lossless picture, in seconds). It writes a JSON list with an object for each round: `last` (time of the last camera)
and `pictures`, each as (time, kind, width, height). All times are in seconds by the same clock.
"""

from __future__ import annotations

import asyncio
import io
import json
import sys
import time
from typing import Any

_EVERY = 1 / 60  # seconds between two cameras

Picture = tuple[float, str, int, int]


async def _receive(socket: Any, pictures: list[tuple[float, str, bytes]]) -> None:
    """Keep the last picture of each packet of messages: the one that a browser would show."""
    import msgspec
    import zstandard

    unpack = zstandard.ZstdDecompressor().decompress
    async for raw in socket:
        packed = int.from_bytes(raw[8:16], "little")
        messages = msgspec.msgpack.decode(unpack(raw[16 : 16 + packed]))["messages"]
        shown = [one for one in messages if one["type"] == "BackgroundImageMessage" and one["rgb_data"]]
        if shown:
            pictures.append((time.perf_counter(), shown[-1]["format"], shown[-1]["rgb_data"]))


async def _rounds(asked: dict[str, Any]) -> list[dict[str, Any]]:
    import msgspec
    import viser
    import websockets

    width, height = asked["size"]
    fixed = {"type": "ViewerCameraMessage", "fov": asked["fov"], "near": 0.01, "far": 1000.0, "image_width": width}
    fixed |= {"image_height": height, "look_at": (0, 0, 1), "up_direction": (0, 1, 0)}
    address, protocol = asked["url"].replace("http", "ws"), websockets.Subprotocol(f"viser-v{viser.__version__}")
    made: list[dict[str, Any]] = []
    async with websockets.connect(address, subprotocols=[protocol], max_size=None) as socket:
        pictures: list[tuple[float, str, bytes]] = []
        task = asyncio.create_task(_receive(socket, pictures))
        number = 0
        for _ in range(asked["rounds"]):
            pictures.clear()
            last = time.perf_counter()
            end = last + asked["seconds"]
            while last < end:
                wxyz, position = asked["cameras"][number % len(asked["cameras"])]
                number += 1
                await socket.send(msgspec.msgpack.encode({**fixed, "wxyz": wxyz, "position": position}))
                last = time.perf_counter()
                await asyncio.sleep(_EVERY)
            until = last + asked["patience"]
            while time.perf_counter() < until and not any(at > last and kind == "png" for at, kind, _ in pictures):
                await asyncio.sleep(0.002)
            await asyncio.sleep(0.3)  # for outdated pictures, if any still arrive
            made.append({"last": last, "pictures": [_measured(*one) for one in pictures]})
        task.cancel()
    return made


def _measured(at: float, kind: str, data: bytes) -> Picture:
    from PIL import Image

    return at, kind, *Image.open(io.BytesIO(data)).size


if __name__ == "__main__":
    print(json.dumps(asyncio.run(_rounds(json.load(sys.stdin)))))
