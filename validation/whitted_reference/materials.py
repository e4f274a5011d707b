"""What a surface does with light: the textbook's coefficients at a point."""

from __future__ import annotations

from dataclasses import dataclass

from whitted_reference import scene
from whitted_reference.arithmetic import Arithmetic
from whitted_reference.textures import Evaluate, evaluator
from whitted_reference.vectors import BLACK, Colour, Number, scaled

MAX_EXPONENT = 10_000_000  # a texture of exponents is clamped to [0, this]

# Above this exponent (n.h)^p is computed from the sine: with n.h off by a few 2^-53 the plain power is
# off by p times that, 5e-14 here; below it the plain power is the better known of the two.
SMALL_EXPONENT = 100


@dataclass(frozen=True)
class Terms:
    """k_a, k_d, k_s, k_m and the exponent at one point; a term that is black everywhere is None."""

    ambient: Colour | None
    diffuse: Colour
    specular: Colour | None
    mirror: Colour | None
    exponent: Number


class Material:
    """One side of a surface.

    Attributes
    ----------
    constant : its terms, or None where they vary with uv
    textures : what they vary by
    """

    def __init__(self, material: scene.OneSided, settings: scene.Settings, arithmetic: Arithmetic) -> None:
        sources: tuple[scene.Texture, ...]
        self._share: Number = 1
        if isinstance(material, scene.Diffuse):
            rho = material.reflectance
            sources = (rho, rho, BLACK, BLACK)
            self._share = 1 / arithmetic.pi
        elif isinstance(material, scene.Conductor):
            sources = (BLACK, BLACK, BLACK, material.mirror)
        else:
            sources = (material.ambient, material.diffuse, material.specular, material.mirror)
        exponent: scene.Texture = material.exponent if isinstance(material, scene.BlinnPhong) else (1.0, 1.0, 1.0)
        self.textures = [source for source in (*sources, exponent) if not isinstance(source, tuple)]
        # A term that is switched off is black everywhere.
        lit = any(settings.ambient) and settings.enable_ambient
        switches = (lit, settings.enable_diffuse, settings.enable_specular, settings.enable_mirrors)
        self._sources = [
            evaluator(source if on else BLACK, arithmetic) for source, on in zip(sources, switches, strict=True)
        ]
        self._exponent = evaluator(exponent, arithmetic)
        varies = any(callable(source) for source in (*self._sources, self._exponent))
        self.constant: Terms | None = None
        if not varies:
            self.constant = self.at(0, 0)

    def at(self, u: Number, v: Number) -> Terms:
        """Evaluate the coefficients at surface coordinates (u, v)."""
        k_a, k_d, k_s, k_m = (_value(source, u, v) for source in self._sources)
        share = self._share
        exponent = _value(self._exponent, u, v)[0]
        if exponent > MAX_EXPONENT:
            exponent = MAX_EXPONENT
        return Terms(
            scaled(k_a, share) if any(k_a) else None,
            scaled(k_d, share),
            k_s if any(k_s) else None,
            k_m if any(k_m) else None,
            exponent,
        )


def _value(source: Colour | Evaluate, u: Number, v: Number) -> Colour:
    return source(u, v) if callable(source) else source
