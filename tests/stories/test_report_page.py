"""report.html in a real browser, at a desk and on a phone: nothing complains, and what can be switched switches."""

import base64
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from browser import DESKTOP, PHONE, browsing, complaints, dark, opened, picture
from teamslam.cli import main
from teamslam.io import write
from teamslam.model import Names
from worlds import apart, team

MAP = "#map-1"
SIZES = {"desk": DESKTOP, "phone": PHONE}
WORST = ["</script><script>alert(1)</script>", "$x{$ /*data*/ <!--data-->", "\"'&\\ é 机"]


@pytest.fixture(scope="module")
def chrome() -> Iterator[Any]:
    """One browser for all."""
    with browsing() as found:
        yield found


@pytest.fixture(scope="module")
def pages(data: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The page of a run by name, each run made once from the command line."""
    made: dict[str, Path] = {}
    place = tmp_path_factory.mktemp("pages")

    def log(name: str) -> Path:
        if name == "mrclam_6":
            return data("mrclam_6")
        if name == "victoria park":
            return data("islsjf_vicpark_200") / "VicPark_clean_data.mat"
        worlds = {"space": lambda: team("3d"), "apart": apart, "names": badly_named}
        write(worlds[name](), place / f"{name}-log", "plain")
        return place / f"{name}-log"

    def page(name: str) -> Path:
        if name not in made:
            assert main(["run", str(log(name)), "--out", str(place / name), "--quiet"]) <= 1
            made[name] = place / name / "report.html"
        return made[name]

    return page


def badly_named() -> Any:
    """A team whose robots are called what ends scripts and fills holes of templates."""
    log = team("2d", robots=3)
    return replace(log, names=Names(dict(enumerate(WORST, start=1)), {0: WORST[0], 1: WORST[1]}, log.names.tick_s))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", ["mrclam_6", "victoria park", "space", "apart"])
def test_the_page_works(chrome: Any, pages: Callable[[str], Path], name: str, size: str) -> None:
    """The console is silent; each switch changes the map and gives it back; the slider moves it; nothing sticks out."""
    dark(chrome, size == "phone")
    opened(chrome, pages(name), SIZES[size])
    whole = picture(chrome, MAP)
    for box in chrome.find_elements("css selector", "#layers input[type=checkbox]"):
        label = box.find_element("xpath", "..")
        chrome.execute_script("arguments[0].scrollIntoView({block: 'center'})", label)
        label.click()
        without = picture(chrome, MAP)
        assert without != whole or box.get_attribute("id") == "layer-seen", box.get_attribute("id")
        label.click()
        assert picture(chrome, MAP) == whole, box.get_attribute("id")
    slide(chrome, 0.5)
    middle, clock = picture(chrome, MAP), chrome.find_element("id", "clock").text
    assert middle != whole and clock
    slide(chrome, 0.2)
    assert picture(chrome, MAP) not in (middle, whole) and chrome.find_element("id", "clock").text != clock
    wide = chrome.execute_script("return [document.documentElement.scrollWidth, window.innerWidth]")
    assert wide[0] <= wide[1]
    assert complaints(chrome) == []


def slide(chrome: Any, share: float) -> None:
    """A tap on the slider, at a share of its length."""
    from selenium.webdriver import ActionChains

    slider = chrome.find_element("id", "slider")
    chrome.execute_script("arguments[0].scrollIntoView({block: 'center'})", slider)
    across = int((share - 0.5) * slider.size["width"])
    ActionChains(chrome).move_to_element_with_offset(slider, across, 0).click().perform()


def test_a_mouse_zooms_shifts_and_asks(chrome: Any, pages: Callable[[str], Path]) -> None:
    """The wheel zooms, a drag shifts, two clicks show all again, a landmark under the mouse says where it is."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin

    opened(chrome, pages("mrclam_6"))
    canvas, whole = chrome.find_element("css selector", MAP), picture(chrome, MAP)
    ActionChains(chrome).scroll_from_origin(ScrollOrigin.from_element(canvas), 0, -300).perform()
    near = picture(chrome, MAP)
    ActionChains(chrome).click_and_hold(canvas).move_by_offset(60, 30).release().perform()
    assert len({whole, near, picture(chrome, MAP)}) == 3
    ActionChains(chrome).double_click(canvas).perform()
    assert picture(chrome, MAP) == whole
    for across in range(-500, 501, 10):
        ActionChains(chrome, duration=0).move_to_element_with_offset(canvas, across, -90).perform()
        if "landmark" in chrome.find_element("id", "info").text:
            break
    assert "from its truth" in chrome.find_element("id", "info").text


def test_fingers_pinch_and_turn(chrome: Any, pages: Callable[[str], Path]) -> None:
    """Two fingers apart show more of a map; one turns a team in space; the views look from their sides."""
    opened(chrome, pages("space"), PHONE)
    chrome.execute_script("document.querySelector(arguments[0]).scrollIntoView({block: 'center'})", MAP)
    x, y, wide, high = box(chrome, MAP)
    x, y = x + wide / 2, y + high / 2
    seen = [picture(chrome, MAP)]
    touch(chrome, [[(x - 20, y), (x + 20, y)], [(x - 60, y), (x + 60, y)]])
    seen.append(picture(chrome, MAP))
    touch(chrome, [[(x, y)], [(x + 50, y + 20)]])
    seen.append(picture(chrome, MAP))
    for view in ("top", "front", "side", "turned"):
        chrome.find_element("css selector", f"[data-view={view}]").click()
        seen.append(picture(chrome, MAP))
    assert len(set(seen[:-1])) == len(seen) - 1
    assert seen[-1] == seen[0]  # turned, and all of it, is how it began


def box(chrome: Any, selector: str) -> list[float]:
    """Where an element is in the window: x, y, width, height."""
    asked = (
        "const r = document.querySelector(arguments[0]).getBoundingClientRect(); return [r.x, r.y, r.width, r.height]"
    )
    found: list[float] = chrome.execute_script(asked, selector)
    return found


def touch(chrome: Any, moves: list[list[tuple[float, float]]]) -> None:
    """Fingers set down, moved and lifted."""
    for kind, points in [("touchStart", moves[0]), *(("touchMove", move) for move in moves[1:]), ("touchEnd", [])]:
        fingers = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(points)]
        chrome.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})


def test_two_maps_stand_side_by_side(chrome: Any, pages: Callable[[str], Path]) -> None:
    """At a desk beside each other, on a phone below each other; one slider for both."""
    opened(chrome, pages("apart"))
    (x1, y1), (x2, y2) = (box(chrome, canvas)[:2] for canvas in (MAP, "#map-2"))
    assert x1 < x2 and y1 == y2
    both = [picture(chrome, MAP), picture(chrome, "#map-2")]
    slide(chrome, 0.3)
    assert picture(chrome, MAP) != both[0] and picture(chrome, "#map-2") != both[1]
    assert "could not be joined" in chrome.find_element("css selector", ".alert").text
    opened(chrome, pages("apart"), PHONE)
    (x1, y1), (x2, y2) = (box(chrome, canvas)[:2] for canvas in (MAP, "#map-2"))
    assert x1 == x2 and y1 < y2


def test_colours_are_explained(chrome: Any, pages: Callable[[str], Path]) -> None:
    """By error and by residual the map looks otherwise, and a scale says what its colours are."""
    from selenium.webdriver.support.ui import Select

    opened(chrome, pages("mrclam_6"))
    seen, scale = {picture(chrome, MAP)}, chrome.find_element("id", "scale")
    for word, unit in (("error", "m from the truth"), ("residual", "sigma")):
        Select(chrome.find_element("id", "colour")).select_by_value(word)
        seen.add(picture(chrome, MAP))
        assert unit in scale.text
    assert len(seen) == 3
    Select(chrome.find_element("id", "colour")).select_by_value("robot")
    assert picture(chrome, MAP) in seen and not scale.is_displayed()


def test_names_are_words(chrome: Any, pages: Callable[[str], Path]) -> None:
    """Robots called like the end of a script stand in the legend as they are called."""
    opened(chrome, pages("names"))
    assert [e.text for e in chrome.find_elements("css selector", "#legend .robot")] == WORST
    assert complaints(chrome) == []


def test_it_is_small_asks_no_network_and_prints(chrome: Any, pages: Callable[[str], Path]) -> None:
    """Below 5 MB for five robots of fifteen minutes; no address is asked; on paper the details are open."""
    page = pages("mrclam_6")
    assert page.stat().st_size < 5e6
    dark(chrome, True)
    opened(chrome, page)
    asked = chrome.execute_script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in asked if not name.startswith("data:")] == []
    paper = base64.b64decode(chrome.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})["data"])
    assert paper.startswith(b"%PDF") and complaints(chrome) == []
    dark(chrome, False)
