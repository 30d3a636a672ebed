"""A real browser for tests of pages: Debian's Chromium without a window, driven by selenium; skipped where absent."""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

DESKTOP = {"width": 1280, "height": 900, "deviceScaleFactor": 1, "mobile": False}
PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
CHROMIUM, DRIVER = ("chromium", "chromium-browser", "google-chrome"), ("chromedriver", "chromium-driver")


def programs() -> tuple[str, str]:
    """The browser and its driver; the test is skipped with the reason where one is absent."""
    browser = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    driver = next((found for name in DRIVER if (found := shutil.which(name))), None)
    if browser is None or driver is None:
        pytest.skip("no Chromium with its driver here; on Debian: apt-get install chromium chromium-driver")
    return browser, driver


@contextmanager
def browsing() -> Iterator[Any]:
    """A browser for one test after another."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed: pip install selenium")
    browser, driver = programs()
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars", "--disable-gpu"):
        options.add_argument(flag)
    options.add_argument("--enable-unsafe-swiftshader")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    chrome = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        yield chrome
    finally:
        chrome.quit()


def opened(chrome: Any, address: Path | str, size: Mapping[str, Any] = DESKTOP) -> None:
    """A page in a window of a size; what an earlier page said is forgotten."""
    chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", dict(size))
    chrome.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": size["mobile"], "maxTouchPoints": 2})
    chrome.get_log("browser")
    chrome.get(address if isinstance(address, str) else address.resolve().as_uri())


def complaints(chrome: Any) -> list[str]:
    """What the console has said since the page was opened, warnings and errors."""
    return [entry["message"] for entry in chrome.get_log("browser") if entry["level"] in ("WARNING", "SEVERE")]


def dark(chrome: Any, on: bool) -> None:
    """Whether the reader prefers dark pages."""
    chrome.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-color-scheme", "value": "dark" if on else "light"}]},
    )


def picture(chrome: Any, selector: str) -> str:
    """What a canvas shows: two of them are equal where all their dots are."""
    asked = "return document.querySelector(arguments[0]).toDataURL()"
    chrome.execute_async_script("const d = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(d))")
    return sha256(chrome.execute_script(asked, selector).encode()).hexdigest()


def whole_page(chrome: Any, path: Path) -> None:
    """A screenshot of all of a page, to look at."""
    import base64

    shot = chrome.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True, "format": "png",
                                                            "clip": _all_of(chrome)})  # fmt: skip
    path.write_bytes(base64.b64decode(shot["data"]))


def _all_of(chrome: Any) -> dict[str, float]:
    size = chrome.execute_script("return [document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    return {"x": 0, "y": 0, "width": size[0], "height": min(size[1], 9000), "scale": 1}
