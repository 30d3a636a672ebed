"""`teamslam keys`: certificates of a team."""

from pathlib import Path

import pytest

pytest.importorskip("cryptography")


def test_each_robot_gets_a_certificate_of_the_one_authority(teamslam, tmp_path: Path) -> None:
    from cryptography import x509

    assert teamslam("keys", tmp_path, "--robots", 1, 2).code == 0
    assert teamslam("keys", tmp_path, "--robots", 7, "--hosts", "10.0.0.7", "seven.local").code == 0
    authority = x509.load_pem_x509_certificate((tmp_path / "authority.crt").read_bytes())
    for robot in (1, 2, 7):
        own = x509.load_pem_x509_certificate((tmp_path / f"robot-{robot}.crt").read_bytes())
        own.verify_directly_issued_by(authority)
        assert own.subject.rfc4514_string() == f"CN=robot-{robot}"


def test_a_second_certificate_of_a_robot_and_numbers_that_are_none_are_refused(teamslam, tmp_path: Path) -> None:
    assert teamslam("keys", tmp_path, "--robots", 1).code == 0
    again = teamslam("keys", tmp_path, "--robots", 1)
    assert again.code == 2 and "has a certificate already" in again.err
    wrong = teamslam("keys", tmp_path, "--robots", 0)
    assert wrong.code == 2 and "from 1 to 4095, found 0" in wrong.err


def test_nobody_is_revoked_who_is_not_there(teamslam, tmp_path: Path) -> None:
    assert teamslam("keys", tmp_path, "--robots", 1, 2).code == 0
    called = teamslam("keys", tmp_path, "--revoke", 2, 9)
    assert called.code == 2 and "robot 9 has no certificate here" in called.err and "robots 1, 2" in called.err
    assert not list(tmp_path.glob("*.revoked"))
    (tmp_path / "robot-2.crt").unlink()  # what it signs with is still known
    assert teamslam("keys", tmp_path, "--revoke", 2).code == 0 and (tmp_path / "robot-2.revoked").exists()
