"""What all tests share: hypothesis settings, and the published data sets where they are at hand.

The data sets are not part of the project (most state no licence). Tests look for their archives in `$TEAMSLAM_DATA`,
or in `../shared/data` beside the checkout, unpack each once into `.cache/data`, and skip with the reason where one is
absent.
"""

import lzma
import os
import shutil
import tarfile
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("TEAMSLAM_DATA") or ROOT.parent / "shared" / "data")
CACHE = ROOT / ".cache" / "data"

# No test times anything; the same examples every time, so that a failure in CI repeats at home. Look for new ones with
# `pytest --hypothesis-profile=explore`.
settings.register_profile(
    "teamslam", deadline=None, derandomize=True, max_examples=50, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile("teamslam")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--stress-seed N`: other random logs for tests/stress than the ones it always takes."""
    parser.addoption("--stress-seed", type=int, default=1_000_000, help="the first seed of tests/stress")


@pytest.fixture(scope="session")
def data() -> Callable[[str], Path]:
    """data("mrclam_6") is the unpacked data set's folder (or file); the test is skipped where it is absent."""

    def find(name: str) -> Path:
        for suffix in (".tar.xz", ".xz"):
            if (archive := DATA / f"{name}{suffix}").is_file():
                return unpacked(archive, CACHE / name)
        pytest.skip(f"data set '{name}' is not in {DATA}; put its archive there or set TEAMSLAM_DATA")

    return find


def unpacked(archive: Path, folder: Path) -> Path:
    """The content of an archive, unpacked once, also when several processes ask at the same time."""
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=folder.parent))
        if archive.name.endswith(".tar.xz"):
            with tarfile.open(archive) as tar:
                # Python 3.11.2, which Debian 12 ships, knows no filters yet.
                tar.extractall(fresh, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
        else:
            with lzma.open(archive) as packed, open(fresh / archive.stem, "wb") as plain:
                shutil.copyfileobj(packed, plain)
        try:
            fresh.rename(folder)
        except OSError:  # another process was quicker
            shutil.rmtree(fresh)
    entries = sorted(folder.iterdir())
    return entries[0] if len(entries) == 1 else folder
