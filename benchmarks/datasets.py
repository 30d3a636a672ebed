"""Where the published data sets are: `$TEAMSLAM_DATA`, or ../shared/data beside the checkout, packed as .tar.xz.

None of them belongs to the project. Each is unpacked once, into `.cache/data`.
"""

import os
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("TEAMSLAM_DATA") or ROOT.parent / "shared" / "data")
CACHE = ROOT / ".cache" / "data"
VICTORIA_PARK = "islsjf_vicpark_200"


def folder_of(name: str) -> Path:
    """The unpacked folder of a data set; ends the program with the reason where it is not there."""
    archive, folder = DATA / f"{name}.tar.xz", CACHE / name
    if not folder.is_dir():
        if not archive.is_file():
            sys.exit(f"data set '{name}' is not in {DATA}; put its archive there or set TEAMSLAM_DATA")
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=folder.parent))
        with tarfile.open(archive) as tar:
            # Python 3.11.2, which Debian 12 ships, knows no filters yet.
            tar.extractall(fresh, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
        fresh.rename(folder)
    entries = sorted(folder.iterdir())
    return entries[0] if len(entries) == 1 else folder
