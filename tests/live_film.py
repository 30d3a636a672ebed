"""A film of two tags that go by, and of a third from its middle on, with a team file of the camera that shot it."""

from pathlib import Path

from tag_pictures import picture, square
from teamslam.io.bags.videos import write_video

FRAMES = 24

TEAM = """
[tags]
size_m = 0.1
fewest = 1
[[robot]]
name = "hand"
recording = "film.avi"
image_every_s = {every}
[[robot.camera]]
name = "eye"
images = "*"
calibration = "eye.json"
delay_s = -0.02
"""
EYE = (
    '{"camera_matrix": [200, 0, 120, 0, 200, 80, 0, 0, 1], "distortion_coefficients": [], '
    '"image_width": 240, "image_height": 160}'
)


def shot(folder: Path) -> Path:
    """The folder with the film in it."""

    def shown(k: int) -> dict:
        tags = {3: square((60 + 2 * k, 60), 44, 0.02 * k, 0.1), 8: square((150.5, 100 - k), 40, -0.4, 0.2)}
        return tags | ({5: square((50, 115), 40, 0.3, 0.15)} if k >= FRAMES // 2 else {})

    write_video(folder / "film.avi", [picture(shown(k), (240, 160), blur=0.5) for k in range(FRAMES)], 8.0)
    (folder / "eye.json").write_text(EYE)
    return folder


def team(folder: Path, every: float) -> Path:
    """The team file, of which an image is used every so many seconds."""
    path = folder / f"every-{every}.toml"
    path.write_text(TEAM.format(every=every))
    return path
