"""What can be wrong with a scene: one line each, for the person who wrote it."""

from __future__ import annotations


class SceneError(ValueError):
    """The scene is wrong: names the file, the element, the value and what is allowed, in one line."""

    def __init__(self, message: str) -> None:
        super().__init__("".join(c if c.isprintable() else "?" for c in message))


class NotDefined(SceneError):
    """The scene holds a feature that the written picture does not define, so it cannot be judged."""

    def __init__(self, feature: str, name: str, where: str) -> None:
        super().__init__(f"{where}: not judged: {feature} `{name}`")
        self.feature = feature
        self.name = name
        self.where = where

    def __reduce__(self) -> tuple[type[NotDefined], tuple[str, str, str]]:
        """Rebuild from the three parts, so that the error survives the way back from a worker process."""
        return NotDefined, (self.feature, self.name, self.where)
