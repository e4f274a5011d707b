"""What the plugins say when they cannot draw a scene as it is defined."""


class SceneError(ValueError):
    """A scene that the integrator `whitted` cannot draw; one line that names the object and the value."""
