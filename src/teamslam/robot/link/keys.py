"""The certificates of a team: an authority that only signs, and a certificate and key for each robot.

A certificate's common name is the robot's number in words: `robot-3`. Who holds the authority's key can make robots of
the team; it belongs on no robot.
"""

import datetime
import ipaddress
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from teamslam.errors import InputError, MissingExtraError
from teamslam.model.keys import MAX_ROBOT

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

AUTHORITY = "authority"
DAYS = 3650


def common_name(robot: int) -> str:
    """What a robot's certificate calls it."""
    return f"robot-{robot}"


def make_certificates(folder: Path, robots: Iterable[int], hosts: Iterable[str] = ("127.0.0.1", "localhost")) -> None:
    """Certificates of some robots (`robot-3.crt`, `robot-3.key`), signed by the authority in the folder, which is made
    where there is none. `hosts`: names and addresses at which the robots may be reached.

    Raises InputError where a robot has one already: two would be two robots of one name.
    """
    try:
        from cryptography import x509
    except ModuleNotFoundError:
        raise MissingExtraError("certificates need the package cryptography: pip install 'teamslam[robots]'") from None
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


def _builder(name: str, issuer: "x509.Name", own: "EllipticCurvePrivateKey") -> "x509.CertificateBuilder":
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


def _key_bytes(key: "EllipticCurvePrivateKey") -> bytes:
    from cryptography.hazmat.primitives import serialization as s

    return key.private_bytes(s.Encoding.PEM, s.PrivateFormat.PKCS8, s.NoEncryption())


def _signed(builder: "x509.CertificateBuilder", key: "EllipticCurvePrivateKey") -> bytes:
    from cryptography.hazmat.primitives import hashes, serialization

    return builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


def _write(path: Path, data: bytes, *, private: bool = False) -> None:
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600 if private else 0o644), "wb") as file:
        file.write(data)
