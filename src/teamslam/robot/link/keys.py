"""The certificates of a team: an authority that only signs, and two certificates and keys for each robot.

    robot-3.crt, robot-3.key              by which it proves who it is to whom it talks to (TLS)
    robot-3.sign.crt, robot-3.sign.key    by which it signs its submaps, whoever passes them on (Ed25519)
    robot-3.revoked                       that all its submaps are out: signed by the authority, passed on by all

A certificate's common name is the robot's number in words: `robot-3`. Who holds the authority's key can make robots of
the team; it belongs on no robot.
"""

import datetime
import ipaddress
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from teamslam.errors import InputError, MissingExtraError
from teamslam.model import Names
from teamslam.model.keys import MAX_ROBOT
from teamslam.robot.packets import EVER, Body, Removal, from_bytes, to_bytes
from teamslam.robot.seal import HOME, Seal, Verify, spoken

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    PrivateKey = EllipticCurvePrivateKey | Ed25519PrivateKey

AUTHORITY = "authority"
DAYS = 3650


def common_name(robot: int) -> str:
    """What a robot's certificate calls it."""
    return f"robot-{robot}"


def make_certificates(folder: Path, robots: Iterable[int], hosts: Iterable[str] = ("127.0.0.1", "localhost")) -> None:
    """Certificates of some robots, signed by the authority in the folder, which is made where there is none. `hosts`:
    names and addresses at which the robots may be reached.

    Raises InputError where a robot has one already: two would be two robots of one name.
    """
    refuse_without_cryptography()
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    robots = list(robots)
    if wrong := [robot for robot in robots if not 1 <= robot <= MAX_ROBOT]:
        raise InputError(f"robots are numbered from 1 to {MAX_ROBOT}, found {wrong[0]}", field="robots")
    folder.mkdir(parents=True, exist_ok=True)
    authority, key = _authority(folder)
    places: list[x509.GeneralName] = []
    for host in hosts:
        try:
            places.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            places.append(x509.DNSName(host))
    for robot in robots:
        name = common_name(robot)
        if (folder / f"{name}.crt").exists():
            raise InputError(f"{name} has a certificate already; move it away to make another", path=folder)
        own = _new_key()
        builder = _builder(name, authority.subject, own).add_extension(x509.SubjectAlternativeName(places), False)
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        _write(folder / f"{name}.key", _key_bytes(own), private=True)
        _write(folder / f"{name}.crt", _signed(builder, key))
        signs = Ed25519PrivateKey.generate()
        builder = _builder(f"{name} signs", authority.subject, signs)
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        _write(folder / f"{name}.sign.key", _key_bytes(signs), private=True)
        _write(folder / f"{name}.sign.crt", _signed(builder, key))


def revoke(folder: Path, team: str, robots: Iterable[int]) -> None:
    """Sign, as the authority in the folder, that all submaps of some robots are out of a team's maps, for ever
    (`robot-3.revoked`): one robot that is given the file tells the others.

    Raises InputError where the folder has no authority with its key, or no certificate of one of these robots: then
    nobody is revoked.
    """
    refuse_without_cryptography()
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec

    for path in (folder / f"{AUTHORITY}.crt", folder / f"{AUTHORITY}.key"):
        if not path.exists():
            raise InputError("only the authority of a team can revoke, and there is no such file", path=path)
    robots, known = list(robots), robots_in(folder)
    if strangers := sorted(set(robots) - set(known)):
        raise InputError(
            f"robot {strangers[0]} has no certificate here, so there is nothing to revoke; there are robots "
            f"{', '.join(map(str, known)) or 'none'}",
            path=folder,
            field="revoke",
        )
    _, key = _authority(folder)
    for robot in robots:
        data = to_bytes(Removal(robot, "", EVER))
        body = Body(data, HOME, key.sign(spoken(team, data), ec.ECDSA(hashes.SHA256())))
        _write(folder / f"{common_name(robot)}.revoked", to_bytes(body))


def robots_in(folder: Path) -> list[int]:
    """The numbers of the robots that have a certificate in a folder, of either kind, rising."""
    names = (path.name.split(".")[0].removeprefix("robot-") for path in folder.glob("robot-*.crt"))
    return sorted({int(name) for name in names if name.isdigit()})


def read_revocations(folder: Path) -> list[Body]:
    """The revocations in a folder. Raises InputError where one makes no sense."""
    found = []
    for path in sorted(folder.glob("*.revoked")):
        packet = from_bytes(path.read_bytes())
        if not isinstance(packet, Body):
            raise InputError("this is no revocation", path=path)
        found.append(packet)
    return found


def read_seal(folder: Path, team: str, robot: int, members: Iterable[int], names: Names) -> Seal:
    """How a robot of a team signs, and knows what the members signed, by the certificates in a folder: its own key, and
    `robot-N.sign.crt` of every member.

    Raises InputError where a file is missing, makes no sense, or is not of this authority.
    """
    refuse_without_cryptography()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    path = folder / f"{common_name(robot)}.sign.key"
    own = load_pem_private_key(_read(path), None)
    if not isinstance(own, Ed25519PrivateKey):
        raise InputError("this is no key that signs submaps (Ed25519)", path=path)
    for key in (path, folder / f"{common_name(robot)}.key"):
        _refuse_another(key, robot)
    known = {member: _verifier(folder, member) for member in {robot, *members}}
    return Seal(team, robot, own.sign, known | {HOME: _home(folder)}, names)


def _refuse_another(path: Path, robot: int) -> None:
    """Raises InputError where a robot's key is not that of its certificate, and says whose it is, where that is
    known."""
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    certificate = path.with_suffix(".crt")
    try:
        own, named = load_pem_private_key(_read(path), None), x509.load_pem_x509_certificate(_read(certificate))
    except (ValueError, TypeError) as error:
        raise InputError(f"this key or {certificate.name} beside it makes no sense: {error}", path=path) from None
    if own.public_key() == named.public_key():
        return
    others = (p for p in sorted(path.parent.glob("*.crt")) if p != certificate)
    fits = [p.name for p in others if own.public_key() == x509.load_pem_x509_certificate(p.read_bytes()).public_key()]
    whose = f"it is that of {fits[0]}" if fits else "it fits no certificate here"
    raise InputError(
        f"this key does not fit {certificate.name}: {whose}; give each robot its own files, as `teamslam keys` made "
        f"them",
        path=path,
    )


def _verifier(folder: Path, robot: int) -> Verify:
    """Whether a robot signed some bytes, by its certificate."""
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    path = folder / f"{common_name(robot)}.sign.crt"
    try:
        certificate = x509.load_pem_x509_certificate(_read(path))
        certificate.verify_directly_issued_by(x509.load_pem_x509_certificate(_read(folder / f"{AUTHORITY}.crt")))
    except (InvalidSignature, ValueError, TypeError):
        raise InputError(f"this is no certificate of the authority in {folder}", path=path) from None
    key = certificate.public_key()
    if certificate.subject.rfc4514_string() != f"CN={common_name(robot)} signs" or not isinstance(
        key, Ed25519PublicKey
    ):
        raise InputError(f"this is not the certificate by which {common_name(robot)} signs", path=path)
    return _asking(key.verify)


def _home(folder: Path) -> Verify:
    """Whether the authority signed some bytes."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec

    key = x509.load_pem_x509_certificate(_read(folder / f"{AUTHORITY}.crt")).public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)
    return _asking(lambda signature, data: key.verify(signature, data, ec.ECDSA(hashes.SHA256())))


def _asking(verify: Callable[[bytes, bytes], None]) -> Verify:
    from cryptography.exceptions import InvalidSignature

    def verified(signature: bytes, data: bytes) -> bool:
        try:
            verify(signature, data)
        except InvalidSignature:
            return False
        return True

    return verified


def _read(path: Path) -> bytes:
    if not path.exists():
        raise InputError("there is no such file; `teamslam keys` makes it", path=path)
    return path.read_bytes()


def refuse_without_cryptography() -> None:
    """Raises MissingExtraError where the package is not installed."""
    try:
        import cryptography  # noqa: F401
    except ModuleNotFoundError:
        raise MissingExtraError("certificates need the package cryptography: pip install 'teamslam[robots]'") from None


def _authority(folder: Path) -> "tuple[x509.Certificate, EllipticCurvePrivateKey]":
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    certificate, secret = folder / f"{AUTHORITY}.crt", folder / f"{AUTHORITY}.key"
    if not certificate.exists():
        own = _new_key()
        subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, AUTHORITY)])
        builder = _builder(AUTHORITY, subject, own).add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
        _write(secret, _key_bytes(own), private=True)
        _write(certificate, _signed(builder, own))
    key = load_pem_private_key(secret.read_bytes(), None)
    assert isinstance(key, EllipticCurvePrivateKey)
    return x509.load_pem_x509_certificate(certificate.read_bytes()), key


def _builder(name: str, issuer: "x509.Name", own: "PrivateKey") -> "x509.CertificateBuilder":
    from cryptography import x509

    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)]))
        .issuer_name(issuer)
        .public_key(own.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=DAYS))
    )


def _new_key() -> "EllipticCurvePrivateKey":
    from cryptography.hazmat.primitives.asymmetric import ec

    return ec.generate_private_key(ec.SECP256R1())


def _key_bytes(key: "PrivateKey") -> bytes:
    from cryptography.hazmat.primitives import serialization as s

    return key.private_bytes(s.Encoding.PEM, s.PrivateFormat.PKCS8, s.NoEncryption())


def _signed(builder: "x509.CertificateBuilder", key: "EllipticCurvePrivateKey") -> bytes:
    from cryptography.hazmat.primitives import hashes, serialization

    return builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


def _write(path: Path, data: bytes, *, private: bool = False) -> None:
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600 if private else 0o644), "wb") as file:
        file.write(data)
