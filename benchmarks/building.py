"""The figures of docs/recordings.md, 'A real building': tags of recordings 10 and 11 of TagSLAM against the survey.

    python benchmarks/building.py FOLDER      # with test_10 and test_11, as the tests unpack them in .cache/data

Maps are made by the noise as it is stated. The team files are those of tests/stories/test_recordings.py.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "tests" / part) for part in ("", "stories")]

from test_recordings import building, survey_of  # noqa: E402

import teamslam as ts  # noqa: E402
from teamslam.geometry import align  # noqa: E402
from teamslam.model import index_of, is_landmark  # noqa: E402
from teamslam.pipeline import run  # noqa: E402

WRONG = (6, 79, 97)  # of the survey: two recordings agree on that
TEN = """[[robot]]
name = "ten"
recording = "{folder}/test_10/tag_detections.bag"
image_every_s = 1.0
[[robot.camera]]
name = "pg"
tags = "/pg_17274483/tags"
calibration = "{folder}/test_10/cameras.yaml"
"""


def main(folder: Path) -> None:
    """Prints the table."""
    survey, alone = survey_of(folder), building(folder)
    one, both = (values_of(text) for text in (alone, alone + TEN.format(folder=folder)))
    of_eleven = [k for k in tags_of(one) if k in survey]
    honest = [k for k in of_eleven if k not in WRONG]
    for name, values, tags in (
        ("11 alone, its tags", one, of_eleven),
        ("10 and 11, the same", both, of_eleven),
        ("11 alone, without the wrong ones", one, honest),
        ("10 and 11, without these", both, honest),
        ("10 and 11, the whole map", both, [k for k in tags_of(both) if k in survey]),
    ):
        found, said = values.positions(np.array(tags), 3), np.array([survey[k] for k in tags])
        off = np.linalg.norm(align(found, said).pose.act(found) - said, axis=1)
        print(f"{name:34} {len(tags):3} tags   median {np.median(off):.3f} m   RMS {np.sqrt(np.mean(off**2)):.3f} m")


def values_of(text: str):
    """The largest map of a team file."""
    with TemporaryDirectory() as place:
        (Path(place) / "team.toml").write_text(text)
        return run(ts.read(Path(place) / "team.toml")).joined.components[0].map.all_values


def tags_of(values) -> list[int]:
    """The numbers of its tags."""
    return [int(index_of(k)) for k in values.layout.keys.tolist() if is_landmark(k)]


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
