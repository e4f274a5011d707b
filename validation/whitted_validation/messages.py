"""What Mitsuba and the plugins say while they work, one line each on stderr, and errors in one line."""

from __future__ import annotations

import re
from typing import Any

import click
import mitsuba as mi

from whitted_validation.refusal import Refusal, one_line
from whitted_validation.scene_check import Scene

_LEVELS = [mi.LogLevel.Info, mi.LogLevel.Info, mi.LogLevel.Debug, mi.LogLevel.Trace]

_OURS = re.compile(r"\[\w+\.py:\d+\] ")
_SOURCE_LINE = re.compile(r"\[\w+\.(?:cpp|h|py):\d+\] (?:(?:\w+\(\)|<\w+>): )?")
_PLACE = re.compile(
    r"(?:Error while loading|While loading|At) (?P<file>.+?) \(line (?P<line>\d+), col (?P<column>\d+)\): "
)
_FILE = re.compile(r'Error while loading XML file "[^"]*": ')
_PLUGIN = re.compile(r'failed to instantiate \w+ plugin of type "[^"]*": ')
_TRACEBACK = re.compile(r"Traceback \(most recent call last\):\n(?: .*\n)*[\w.]+: ")  # of a plugin in Python
_UNREAD = re.compile(r'Found \d+ unreferenced propert(?:y|ies) in \w+ plugin of type "[^"]*":')


class Messages:
    """Holds back what is logged until `show`, so that a refused scene gets its one line and no other."""

    def __init__(self, verbosity: int) -> None:
        self._waiting: list[str] | None = []
        self._said: set[str] = set()
        hear = self._hear

        class Appender(mi.Appender):
            def append(self, level: mi.LogLevel, text: str) -> None:
                # What a plugin in Python has to say of the scene is for everyone, Mitsuba's own news for -v.
                if verbosity or level >= mi.LogLevel.Warn or _OURS.match(text):
                    hear(text)

            def log_progress(self, *_: Any) -> None:
                pass

        logger = mi.logger()  # type: ignore[operator]  # its stub takes the function for an object
        logger.clear_appenders()
        logger.add_appender(Appender())
        logger.set_log_level(_LEVELS[min(verbosity, len(_LEVELS) - 1)])
        formatter = mi.DefaultFormatter()
        formatter.set_has_date(False)
        formatter.set_has_log_level(False)
        logger.set_formatter(formatter)

    def show(self) -> None:
        """Say what was held back, and from now on speak at once."""
        waiting, self._waiting = self._waiting or [], None
        for text in waiting:
            self._hear(text)

    def _hear(self, text: str) -> None:
        if self._waiting is not None:
            self._waiting.append(text)
        elif text not in self._said:
            self._said.add(text)
            click.echo(f"whitted: {one_line(_SOURCE_LINE.sub('', text))}", err=True)


def refusal(error: Exception, scene: Scene) -> Refusal:
    """Say what Mitsuba or a plugin objects to: file, line, element, and its words.

    Parameters
    ----------
    error
        What ``mi.load_file`` raised.
    scene
        The same file as looked over before, which knows the id of the element at a place.
    """
    text = _TRACEBACK.sub("", _PLUGIN.sub("", _SOURCE_LINE.sub("", str(error))))
    unread = _UNREAD.search(text)
    if unread:
        names = re.findall(r'^  - (\S+) "([^"]*)"', text[unread.end() :], re.MULTILINE)
        shown = ", ".join(f'<{kind} name="{name}">' for kind, name in names)
        text = text[: unread.start()] + f"does not take {shown}; misspelt, or in the wrong place"
    places = list(_PLACE.finditer(text))
    if not places:
        return Refusal(f"{scene.file}: {_FILE.sub('', text)}")
    place = places[-1]  # the innermost, where files are included
    file, line, column = place["file"], int(place["line"]), int(place["column"])
    element = scene.at(file, line, column)
    return Refusal(f"{file}:{line}: {f'{element}: ' if element else ''}{text[place.end() :]}")
