"""What robots say to each other, as bytes: small packets about what is held, and bodies.

    have    what I hold, as one digest: said now and then, to all
    ask     tell me all that you hold: to who holds something else
    list    an entry for each thing held
    want    send me the bodies with these digests
    body    a submap's message, as it was heard

A body is a message of `teamslam.wire`, byte for byte what its robot made. Packets that make no sense raise InputError.
"""

import hashlib
from typing import Annotated

import msgspec

from teamslam.errors import InputError

DIGEST = 16  # bytes of blake2b

Digest = Annotated[bytes, msgspec.Meta(min_length=DIGEST, max_length=DIGEST)]
Count = Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)]


class Entry(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """One thing held: a submap's body (`size` bytes, `rows` numbers measured), or that an id was removed up to a
    version (no digest)."""

    id: str
    version: Count
    digest: Digest | None = None
    size: Count = 0
    rows: Count = 0


class Have(msgspec.Struct, frozen=True, tag="have", array_like=True, forbid_unknown_fields=True):
    """The digest of all that a robot holds."""

    root: Digest


class Ask(msgspec.Struct, frozen=True, tag="ask", array_like=True, forbid_unknown_fields=True):
    """Asks for the list."""


class List(msgspec.Struct, frozen=True, tag="list", array_like=True, forbid_unknown_fields=True):
    """All that a robot holds, and the robots it has removed, each up to a version."""

    entries: tuple[Entry, ...]
    removed_robots: tuple[tuple[Count, Count], ...] = ()


class Want(msgspec.Struct, frozen=True, tag="want", array_like=True, forbid_unknown_fields=True):
    """Asks for bodies, the most wanted first."""

    digests: tuple[Digest, ...]


class Body(msgspec.Struct, frozen=True, tag="body", array_like=True, forbid_unknown_fields=True):
    """A submap's message."""

    data: bytes


Packet = Have | Ask | List | Want | Body

_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Packet)


def to_bytes(packet: Packet) -> bytes:
    """A packet on its way."""
    return _ENCODER.encode(packet)


def from_bytes(data: bytes) -> Packet:
    """The packet that some bytes are. Raises InputError where they are none."""
    try:
        packet: Packet = _DECODER.decode(data)
        return packet
    except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError) as error:
        raise InputError(f"these bytes are no packet of a robot: {error}") from None


def digest_of(data: bytes) -> bytes:
    """What names a body."""
    return hashlib.blake2b(data, digest_size=DIGEST).digest()


def root_of(held: List) -> bytes:
    """What names all that a robot holds: equal where two robots hold the same."""
    return digest_of(to_bytes(held))
