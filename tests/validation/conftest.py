"""A page read as a browser reads it, and a browser: Chromium, driven over its DevTools protocol through a pipe.

WHITTED_TEST_CHROMIUM names the program where it must be there.
"""

from __future__ import annotations

import fcntl
import html.parser
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest


class Page(html.parser.HTMLParser):
    """What a page holds and would load: tags, attributes, what they refer to, and text."""

    def __init__(self, markup: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[str] = []
        self.sources: list[str] = []
        self.text = ""
        self.feed(markup)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag."""
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        """Note text."""
        self.text += data


@pytest.fixture
def read_page() -> Callable[[str], Page]:
    return Page


PATIENCE = 60.0  # seconds until a browser that does not answer fails the test


def chromium() -> str:
    """Find the browser; skip where there is none, fail where there must be one."""
    required = os.environ.get("WHITTED_TEST_CHROMIUM")
    names = [required] if required else ["chromium", "chromium-browser", "google-chrome"]
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        if required:
            pytest.fail(f"WHITTED_TEST_CHROMIUM={required}: no such program")
        pytest.skip("no Chromium on this machine, and WHITTED_TEST_CHROMIUM is not set")
    return found


def _pipe() -> tuple[int, int]:
    """Open a pipe whose ends do not have the numbers that Chromium's get."""
    ends = os.pipe()
    high = fcntl.fcntl(ends[0], fcntl.F_DUPFD_CLOEXEC, 10), fcntl.fcntl(ends[1], fcntl.F_DUPFD_CLOEXEC, 10)
    for end in ends:
        os.close(end)
    return high


class Browser:
    """One page in Chromium, and the commands of its DevTools protocol."""

    def __init__(self, folder: Path) -> None:
        read, self._write = _pipe()
        self._read, write = _pipe()
        options = ["--headless=new", "--remote-debugging-pipe", "--disable-gpu", "--no-first-run", "--hide-scrollbars"]
        options += ["--disable-dev-shm-usage"]  # containers often have little of it
        options += ["--no-sandbox"] if os.geteuid() == 0 else []  # Chromium refuses to sandbox for root
        command = [chromium(), *options, f"--user-data-dir={folder}", "about:blank"]
        # Chromium reads commands from file descriptor 3 and answers on 4.
        start = (
            "import os, sys; [os.dup2(int(sys.argv[i]), 2 + i) for i in (1, 2)]; os.execvp(sys.argv[3], sys.argv[3:])"
        )
        self._process = subprocess.Popen(
            [sys.executable, "-c", start, str(read), str(write), *command],
            pass_fds=(read, write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(read)
        os.close(write)
        self._waiting, self._count, self._session = b"", 0, ""
        self.events: list[dict[str, Any]] = []
        targets = self.send("Target.getTargets")["targetInfos"]
        (page,) = (target["targetId"] for target in targets if target["type"] == "page")
        self._session = self.send("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def close(self) -> None:
        """End the program."""
        self._process.terminate()
        self._process.wait(PATIENCE)
        os.close(self._read)
        os.close(self._write)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command and wait for its answer; what else is heard is kept in `events`."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            heard = self._hear()
            if heard.get("id") == self._count:
                assert "error" not in heard, heard["error"]
                result: dict[str, Any] = heard["result"]
                return result
            self.events.append(heard)

    def _hear(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._waiting:
            ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
            assert ready, "the browser does not answer"
            data = os.read(self._read, 1 << 16)
            assert data, "the browser has ended"
            self._waiting += data
        message, self._waiting = self._waiting.split(b"\0", 1)
        heard: dict[str, Any] = json.loads(message)
        return heard

    def ask(self, expression: str) -> Any:
        """Evaluate JavaScript, and wait for what it promises."""
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def open(self, file: Path, width: int = 1280, height: int = 900, touch: bool = False) -> None:
        """Open a page, and wait until its viewers are there."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=touch)
        self.send("Emulation.setTouchEmulationEnabled", enabled=touch, maxTouchPoints=2)
        self.events.clear()
        self.send("Page.navigate", url=file.as_uri())
        end = time.monotonic() + PATIENCE
        while not self.ask("document.documentElement?.dataset.ready === 'yes'"):
            assert time.monotonic() < end, self.complaints()
            time.sleep(0.02)

    def complaints(self) -> list[str]:
        """Return errors and violations that the page caused."""
        return [json.dumps(e) for e in self.events if e["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")]

    def key(self, name: str, code: int, text: str = "", shift: bool = False) -> None:
        """Press a key."""
        press: dict[str, Any] = {"key": name, "windowsVirtualKeyCode": code, "modifiers": 8 * shift}
        self.send("Input.dispatchKeyEvent", type="keyDown", text=text, **press)
        self.send("Input.dispatchKeyEvent", type="keyUp", **press)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Return where the middle of a pixel of the first picture is on the screen."""
        self.ask("document.querySelector('canvas.view').scrollIntoView({block: 'nearest'})")
        across, down = self.ask(
            f"""(() => {{const v = document.querySelector('.viewer').viewer, box = v.canvas.getBoundingClientRect();
            return [box.left + ({x} + 0.5 - v.left) * v.scale, box.top + ({y} + 0.5 - v.top) * v.scale]}})()"""
        )
        return across, down

    def hover(self, x: int, y: int) -> None:
        """Move the mouse over a pixel."""
        across, down = self.place(x, y)
        self.send("Input.dispatchMouseEvent", type="mouseMoved", x=across, y=down)

    def text(self, selector: str) -> str:
        """Return the text of an element as it is shown."""
        return str(self.ask(f"document.querySelector({json.dumps(selector)}).innerText"))

    def numbers(self, selector: str, columns: int) -> np.ndarray:
        """Read a table of three channels, without the first column."""
        shown = self.ask(f"[...document.querySelectorAll('{selector} td.number')].map((cell) => cell.textContent)")
        words = [word.replace("\N{MINUS SIGN}", "-").replace("\N{INFINITY}", "inf") for word in shown]
        return np.array(words, float).reshape(3, columns)

    def drawn(self, x: int, y: int) -> list[int]:
        """Read the colour in the middle of a pixel from the canvas."""
        return list(
            self.ask(
                f"""(() => {{const v = document.querySelector('.viewer').viewer, s = v.scale * v.ratio;
                const at = [({x} + 0.5 - v.left) * s, ({y} + 0.5 - v.top) * s].map(Math.floor);
                return [...v.canvas.getContext('2d').getImageData(...at, 1, 1).data].slice(0, 3)}})()"""
            )
        )


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()
