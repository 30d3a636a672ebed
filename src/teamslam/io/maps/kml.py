"""Maps as KML (OGC 2.2), for globes; of a map with an anchor. Each robot's way is a line in its colour, each landmark a
point, each 95 % region the outline of a polygon; robots, landmarks and regions are folders, to be switched one by one.
"""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from teamslam.errors import in_words
from teamslam.geometry import Anchor
from teamslam.io.files.text import write_text
from teamslam.io.maps.earth import DEGREES, POSES, TURNED, Feature, features
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.marks import lost
from teamslam.model import Dropped

NAMESPACE = "http://www.opengis.net/kml/2.2"
FOLDERS = {"robot": "robots", "landmark": "landmarks", "region": "95 % regions"}
STAMPS = "stamps of ways: a line of KML has none"


def write(maps: Sequence[MapEstimate], path: Path, anchor: Anchor) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Law: the anchor takes each place back to the map, to its digits."""
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        root = ElementTree.Element("kml", xmlns=NAMESPACE)
        document = _below(root, "Document", name=in_words(file.stem))
        every = list(features(found, anchor))
        for kind, name in FOLDERS.items():
            folder = _below(document, "Folder", name=name)
            for feature in every:
                if feature.kind == kind:
                    _placemark(folder, feature)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode")
        write_text(file, f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n')
    return (*lost(maps, POSES, TURNED), *lost(maps, STAMPS))


def _placemark(folder: ElementTree.Element, feature: Feature) -> None:
    mark = _below(folder, "Placemark", name=in_words(feature.name))
    if feature.kind == "landmark":
        shape = _below(mark, "Point")
    elif feature.kind == "robot":
        _below(_below(mark, "Style"), "LineStyle", color=_colour(feature, 255), width="2")
        shape = _below(mark, "LineString")
    else:
        style = _below(mark, "Style")
        _below(style, "LineStyle", color=_colour(feature, 255))
        _below(style, "PolyStyle", color=_colour(feature, 64))
        shape = _below(_below(_below(mark, "Polygon"), "outerBoundaryIs"), "LinearRing")
    rows = (",".join(f"{number:.{DEGREES}f}" for number in row) for row in feature.coordinates)
    _below(shape, "coordinates").text = " ".join(rows)


def _colour(feature: Feature, opacity: int) -> str:
    """As KML has it: opacity, blue, green, red."""
    red, green, blue = (round(255 * part) for part in feature.colour)
    return f"{opacity:02x}{blue:02x}{green:02x}{red:02x}"


def _below(parent: ElementTree.Element, tag: str, **texts: str) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, tag)
    for name, text in texts.items():
        ElementTree.SubElement(child, name).text = text
    return child
