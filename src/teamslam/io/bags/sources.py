"""Images from wherever they are: a video, a folder, image files, a topic of a recording."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from teamslam.errors import InputError
from teamslam.io.bags.opened import is_recording, opened
from teamslam.io.bags.pictures import Pictures, pictures_of_files, pictures_of_topic
from teamslam.io.bags.roles import ROLES
from teamslam.io.bags.videos import is_video, pictures_of_video

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")


@contextmanager
def images_from(paths: Sequence[Path], topic: str | None = None) -> Iterator[Pictures]:
    """The images of a video, of the topic of a recording or of its parts (the topic may be left out where there is but
    one), of a folder or of files, while they are open. InputError where there is none."""
    first = paths[0]
    if not first.exists():
        raise InputError("there is no such file or folder", path=first)
    if len(paths) == 1 and is_video(first):
        yield pictures_of_video(first)
        return
    if all(map(is_recording, paths)):
        with opened(paths) as recording:
            all_ = [name for name, (types, _) in recording.topics.items() if ROLES.get(types[0]) == "image"]
            if topic is None and len(all_) != 1:
                raise InputError(f"say which images with --topic; there are {', '.join(all_) or 'none'}", path=first)
            yield pictures_of_topic(recording, topic or all_[0])
        return
    if first.is_dir():
        files = sorted(p for path in paths for p in path.iterdir() if p.suffix.lower() in IMAGES)
    else:
        files = sorted(paths)
    if not files:
        raise InputError(f"no images in it; expected files that end in {', '.join(IMAGES)}", path=first)
    for file in files:
        if file.suffix.lower() not in IMAGES:
            raise InputError("neither an image nor a video that is known by its ending", path=file)
    yield pictures_of_files(files)
