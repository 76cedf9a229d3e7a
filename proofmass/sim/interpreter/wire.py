"""Messages between proofmass and the interpreter of an engine: JSON and arrays, no code.

A message is the size of its body in 8 bytes, and a body that `numpy.savez` writes: an array for
each array in the message, and the rest as JSON, in which an array is replaced by its number, and a
data class by its name and fields.  Nothing in a message is executed when it is read.
"""

from __future__ import annotations

import dataclasses
import io
import json
from typing import Any, BinaryIO

import numpy as np

from . import mechanism

LENGTH_BYTES = 8
DATA_CLASSES = {
    name: one
    for name, one in vars(mechanism).items()
    if isinstance(one, type) and dataclasses.is_dataclass(one)
}
"""The data classes that a message may have, by name."""


def pack(message: Any) -> bytes:
    """A message of data classes, dicts, lists, tuples, texts, numbers and arrays as bytes."""
    arrays: dict[str, np.ndarray] = {}

    def plain(thing: Any) -> Any:
        if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
            fields = {one.name: getattr(thing, one.name) for one in dataclasses.fields(thing)}
            return {"class": type(thing).__name__, "fields": plain(fields)}
        if isinstance(thing, np.ndarray):
            arrays[f"a{len(arrays)}"] = thing
            return {"array": len(arrays) - 1}
        if isinstance(thing, np.generic):
            return thing.item()
        if isinstance(thing, dict):
            return {"dict": [[key, plain(value)] for key, value in thing.items()]}
        if isinstance(thing, tuple):
            return {"tuple": [plain(one) for one in thing]}
        if isinstance(thing, list):
            return [plain(one) for one in thing]
        return thing

    text = np.frombuffer(json.dumps(plain(message)).encode(), np.uint8)
    body = io.BytesIO()
    np.savez(body, text=text, **arrays)  # type: ignore[arg-type]
    return body.getvalue()


def unpack(body: bytes) -> Any:
    """The message of bytes that `pack` wrote.

    Raises
    ------
    ValueError, KeyError
        The bytes are no such message.
    """
    with np.load(io.BytesIO(body), allow_pickle=False) as arrays:

        def full(thing: Any) -> Any:
            if isinstance(thing, list):
                return [full(one) for one in thing]
            if not isinstance(thing, dict):
                return thing
            if "class" in thing:
                return DATA_CLASSES[thing["class"]](**full(thing["fields"]))
            if "array" in thing:
                return arrays[f"a{thing['array']}"]
            if "tuple" in thing:
                return tuple(full(one) for one in thing["tuple"])
            return {key: full(value) for key, value in thing["dict"]}

        return full(json.loads(arrays["text"].tobytes().decode()))


def send(stream: BinaryIO, message: Any) -> None:
    """Write a message to a stream."""
    body = pack(message)
    stream.write(len(body).to_bytes(LENGTH_BYTES, "little") + body)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Read a message from a stream.

    Raises
    ------
    EOFError
        The stream ends.
    """
    return unpack(receive_body(stream))


def receive_body(stream: BinaryIO) -> bytes:
    """Read the body of a message from a stream, see `receive`."""
    return _read(stream, int.from_bytes(_read(stream, LENGTH_BYTES), "little"))


def _read(stream: BinaryIO, size: int) -> bytes:
    """Exactly `size` bytes of a stream; EOFError if it ends before."""
    parts, left = [], size
    while left:
        part = stream.read(left)
        if not part:
            raise EOFError
        parts.append(part)
        left -= len(part)
    return b"".join(parts)
