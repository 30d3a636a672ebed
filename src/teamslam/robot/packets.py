"""What robots say to each other, as bytes: small packets about what is held, and bodies.

    have    what I hold, as one digest: said now and then, to all
    ask     tell me what you hold: to who holds something else; with a digest of each shelf of what is held here
    list    an entry for each thing held, on the shelves that differ
    want    send me the bodies with these digests
    exact   a question of exact rounds;   found: its answer
    body    a submap's message, an announcement or a removal, as it was heard, with the signature of its robot

A submap's message is one of `teamslam.wire`, byte for byte what its robot made. An announcement says which landmarks
and whose poses a robot knows (`teamslam.team.knowledge`), a removal that a submap, or all of a robot's, are out up to a
version. Packets that make no sense raise InputError.
"""

import hashlib
from functools import lru_cache
from typing import Annotated

import msgspec

from teamslam.errors import InputError

DIGEST = 16  # bytes of blake2b
SHELVES, SHORT = 64, 8  # on which things stand by their ids, and the bytes of a shelf's digest
MANY = 1 << 16  # things in one packet at most
EVER = (1 << 63) - 1  # a version that nothing comes after

Digest = Annotated[bytes, msgspec.Meta(min_length=DIGEST, max_length=DIGEST)]
Short = Annotated[bytes, msgspec.Meta(max_length=SHORT)]
Name = Annotated[str, msgspec.Meta(max_length=300)]
Count = Annotated[int, msgspec.Meta(ge=0, le=EVER)]
Signature = Annotated[bytes, msgspec.Meta(max_length=128)]


class Entry(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """One thing held, a body of `size` bytes: a submap (`rows` numbers measured), or that an id was removed up to a
    version (`gone`), or all submaps of a robot (`robot`), or a page of what a robot knows (`knows`)."""

    id: Name
    version: Count
    digest: Digest
    size: Count = 0
    rows: Count = 0
    gone: bool = False
    robot: Count = 0
    knows: bool = False


class Have(msgspec.Struct, frozen=True, tag="have", array_like=True, forbid_unknown_fields=True):
    """The digest of all that a robot holds."""

    root: Digest


class Ask(msgspec.Struct, frozen=True, tag="ask", array_like=True, forbid_unknown_fields=True):
    """Asks for the list: of the shelves on which the other does not find the same; of all where there are none."""

    shelves: Annotated[tuple[Short, ...], msgspec.Meta(max_length=SHELVES)] = ()


class List(msgspec.Struct, frozen=True, tag="list", array_like=True, forbid_unknown_fields=True):
    """What a robot holds: all, or what is on some shelves; and what names all that it holds."""

    entries: Annotated[tuple[Entry, ...], msgspec.Meta(max_length=MANY)]
    root: Digest | None = None


class Want(msgspec.Struct, frozen=True, tag="want", array_like=True, forbid_unknown_fields=True):
    """Asks for bodies, the most wanted first."""

    digests: Annotated[tuple[Digest, ...], msgspec.Meta(max_length=MANY)]


class Body(msgspec.Struct, frozen=True, tag="body", array_like=True, forbid_unknown_fields=True):
    """A submap's message, an announcement or a removal; `signature` by `robot` (0: who makes the team's
    certificates)."""

    data: bytes
    robot: Count = 0
    signature: Signature = b""


class Removal(msgspec.Struct, frozen=True, tag="out", array_like=True, forbid_unknown_fields=True):
    """A submap of a robot is out up to a version; all of that robot's where no id is given."""

    robot: Count
    id: str
    version: Count


class Announcement(msgspec.Struct, frozen=True, tag="knows", array_like=True, forbid_unknown_fields=True):
    """A page of what a robot knows: keys, packed; `check` is a digest of the rest, by which damage is known."""

    robot: Count
    page: Count
    keys: bytes
    check: Short = b""

    def checked(self) -> "Announcement":
        """With the digest that it should have."""
        told = f"{self.robot} {self.page} ".encode() + self.keys
        return msgspec.structs.replace(self, check=digest_of(told)[:SHORT])


class Question(msgspec.Struct, frozen=True, tag="exact", array_like=True, forbid_unknown_fields=True):
    """A question of exact rounds on the set that `root` names: on which part of its map, of which attempt, and which
    one."""

    root: Digest
    part: Count
    attempt: Count
    n: Count
    data: bytes


class Answer(msgspec.Struct, frozen=True, tag="found", array_like=True, forbid_unknown_fields=True):
    """The answer to a question of exact rounds."""

    root: Digest
    part: Count
    attempt: Count
    n: Count
    data: bytes


Packet = Have | Ask | List | Want | Body | Question | Answer

_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Packet)
_NEWS = msgspec.msgpack.Decoder(Removal | Announcement)


def to_bytes(packet: Packet | Removal | Announcement) -> bytes:
    """A packet on its way."""
    return _ENCODER.encode(packet)


def from_bytes(data: bytes) -> Packet:
    """The packet that some bytes are. Raises InputError where they are none."""
    try:
        packet: Packet = _DECODER.decode(data)
        return packet
    except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError) as error:
        raise InputError(f"these bytes are no packet of a robot: {error}") from None


def news_from(data: bytes) -> Removal | Announcement:
    """The removal or announcement that a body's bytes are. Raises InputError where they are neither."""
    try:
        news: Removal | Announcement = _NEWS.decode(data)
        return news
    except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError) as error:
        raise InputError(f"these bytes are no submap's message, no announcement and no removal: {error}") from None


def digest_of(data: bytes) -> bytes:
    """What names a body."""
    return hashlib.blake2b(data, digest_size=DIGEST).digest()


@lru_cache(maxsize=1 << 16)
def shelf_of(id: str) -> int:
    """Where a thing stands."""
    return hashlib.blake2b(id.encode(), digest_size=1).digest()[0] % SHELVES


def shelves_of(held: List) -> tuple[bytes, ...]:
    """What names each shelf of what a robot holds; nothing for one that is empty."""
    standing: dict[int, list[Entry]] = {}
    for entry in held.entries:
        standing.setdefault(shelf_of(entry.id), []).append(entry)
    named = {shelf: digest_of(_ENCODER.encode(entries))[:SHORT] for shelf, entries in standing.items()}
    return tuple(named.get(shelf, b"") for shelf in range(SHELVES))


def root_of(held: List) -> bytes:
    """What names all that a robot holds: equal where two robots hold the same."""
    return digest_of(to_bytes(held))
