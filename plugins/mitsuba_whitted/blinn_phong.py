"""The `blinnphong` BSDF: the textbook's material, diffuse term, highlight and mirror."""

from __future__ import annotations

import textwrap
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.precise import specular_power

MAX_EXPONENT = 1e7
"""Beyond it a highlight is narrower than float32 directions are apart: its width p^(-1/2) is 3e-4 here, where
an error of 1e-7 in a direction already moves (n.h)^p by p * 3e-4 * 1e-7, or 3e-4 of itself."""

DIFFUSE, GLOSSY, MIRROR = 0, 1, 2
"""The components, as ``BSDFContext.component`` counts them."""


def define() -> type[mi.BSDF]:
    """Make the plugin class for the variant that is set.

    Returns
    -------
    type
        The class `BlinnPhong`, to be registered as ``blinnphong``.
    """

    class BlinnPhong(mi.BSDF):
        r"""
        .. _bsdf-blinnphong:

        Blinn-Phong material of the textbooks (:monosp:`blinnphong`)
        -------------------------------------------------------------

        .. pluginparameters::

         * - diffuse_reflectance
           - |spectrum| or |texture|
           - Diffuse coefficient :math:`k_d`, in [0, 1]. (Default: 0.5)
           - |exposed|, |differentiable|

         * - specular_reflectance
           - |spectrum| or |texture|
           - Coefficient of the highlight :math:`k_s`, in [0, 1]. (Default: 0)
           - |exposed|, |differentiable|

         * - mirror_reflectance
           - |spectrum| or |texture|
           - Coefficient of the ideal mirror :math:`k_m`, in [0, 1]. (Default: 0)
           - |exposed|, |differentiable|

         * - ambient_reflectance
           - |spectrum| or |texture|
           - Coefficient of the ambient light :math:`k_a`, in [0, 1]; only the integrator
             :monosp:`whitted` has such a light. (Default: the very texture of
             :monosp:`diffuse_reflectance`, edits included)
           - |exposed|, |differentiable|

         * - exponent
           - |float| or |texture|
           - Phong exponent :math:`p`, dimensionless, in [0, 1e7]; of a texture the first channel
             counts, clamped to that range. 0 gives a highlight of :math:`k_s` from wherever the light
             is seen. (Default: 32)
           - |exposed|, |differentiable|

        The model of Blinn (1977) as Shirley, Ashikhmin and Marschner (*Fundamentals of Computer
        Graphics*, 3rd ed., eqs. 4.1 to 4.5) give it, with unit vectors :math:`n` (normal),
        :math:`l` (towards the light), :math:`v` (towards the eye) and :math:`h = (v + l) / |v + l|`:

        .. math::

            k_d \max(0, n \cdot l) + k_s \max(0, n \cdot h)^p

        :monosp:`eval()` returns just this. A BSDF of Mitsuba includes the cosine already, so there is no
        :math:`1/\pi`: Mitsuba's :monosp:`diffuse` of reflectance :math:`\rho` is :math:`k_d = \rho / \pi`.
        The ideal mirror is a delta component: :monosp:`sample()` alone knows it.

        **Energy is not conserved.** Seen along the normal, the terms reflect :math:`\pi k_d`,
        :math:`8 \pi k_s (1 - 2^{-(p+2)/2}) / (p + 2)` and :math:`k_m` of a white sky: with
        :math:`k_d > 1/\pi` more than arrives. The diffuse term and the mirror are reciprocal; the
        highlight, which has no cosine, is reciprocal in :monosp:`eval()` and so not as a BRDF.

        The material is one-sided: zero unless both directions are above the horizon. Nest it in
        :monosp:`twosided` to draw both faces. Edits through :monosp:`mi.traverse` are not checked
        against the ranges. Neither spectral nor polarised variants are supported.

        .. tabs::
            .. code-tab:: xml
                :name: blinnphong

                <bsdf type="blinnphong">
                    <rgb name="diffuse_reflectance" value="0.6, 0.1, 0.1"/>
                    <rgb name="specular_reflectance" value="0.4"/>
                    <rgb name="mirror_reflectance" value="0.2"/>
                    <float name="exponent" value="100"/>
                </bsdf>

            .. code-tab:: python

                'type': 'blinnphong',
                'diffuse_reflectance': {'type': 'rgb', 'value': [0.6, 0.1, 0.1]},
                'specular_reflectance': {'type': 'rgb', 'value': 0.4},
                'mirror_reflectance': {'type': 'rgb', 'value': 0.2},
                'exponent': 100.0
        """  # noqa: D400 (a page of Mitsuba's manual starts with its label)

        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            self.diffuse_reflectance = _reflectance(props, "diffuse_reflectance", 0.5)
            self.specular_reflectance = _reflectance(props, "specular_reflectance", 0.0)
            self.mirror_reflectance = _reflectance(props, "mirror_reflectance", 0.0)
            self.ambient_reflectance = (
                _reflectance(props, "ambient_reflectance")
                if "ambient_reflectance" in props
                else self.diffuse_reflectance
            )
            self.exponent = _exponent(props, "exponent", 32.0)

            self.m_components = [
                flags | mi.BSDFFlags.FrontSide | _variation(*textures)
                for flags, *textures in (
                    (mi.BSDFFlags.DiffuseReflection, self.diffuse_reflectance),
                    (mi.BSDFFlags.GlossyReflection, self.specular_reflectance, self.exponent),
                    (mi.BSDFFlags.DeltaReflection, self.mirror_reflectance),
                )
            ]
            self.m_flags = self.m_components[DIFFUSE] | self.m_components[GLOSSY] | self.m_components[MIRROR]

        def traverse(self, cb: mi.TraversalCallback) -> None:
            for name in PARAMETERS:
                cb.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

        def eval(self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Any = True
        ) -> tuple[Any, Any]:
            cos_theta_o = mi.Frame3f.cos_theta(wo)
            active = active & (mi.Frame3f.cos_theta(si.wi) > 0) & (cos_theta_o > 0)
            prob_diffuse, prob_glossy, _ = self._probabilities(ctx, si, active)
            value, pdf = mi.Spectrum(0), mi.Float(0)

            if ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, DIFFUSE):
                value += self.diffuse_reflectance.eval(si, active) * cos_theta_o
                pdf += prob_diffuse * dr.inv_pi * cos_theta_o

            if ctx.is_enabled(mi.BSDFFlags.GlossyReflection, GLOSSY):
                p = self._exponent(si, active)
                length = dr.norm(si.wi + wo)
                active &= length > 0  # else they are opposite within rounding, and h is nowhere
                power = specular_power(mi.Vector3f(0, 0, 1), (si.wi + wo) / length, p)
                value += self.specular_reflectance.eval(si, active) * power
                # density (p+1)/(2 pi) (n.h)^p of h, over dh/dwo's 4 (h.wi), where h.wi = |wi + wo| / 2
                pdf += prob_glossy * (p + 1) * (0.25 * dr.inv_pi) * power / length

            return dr.select(active, value, mi.Spectrum(0)), dr.select(active, pdf, 0)

        def sample(
            self,
            ctx: mi.BSDFContext,
            si: mi.SurfaceInteraction3f,
            sample1: Any,
            sample2: mi.Point2f,
            active: Any = True,
        ) -> tuple[mi.BSDFSample3f, Any]:
            active = active & (mi.Frame3f.cos_theta(si.wi) > 0)
            prob_diffuse, prob_glossy, prob_mirror = self._probabilities(ctx, si, active)
            mirror = active & (sample1 < prob_mirror)
            smooth = active & (sample1 >= prob_mirror)
            # prob_glossy > 0: the sum of the other two may be rounded down to less than 1
            glossy = smooth & (sample1 >= prob_mirror + prob_diffuse) & (prob_glossy > 0)

            # Direction and density are detached, the value is not: then its mean has the derivative of the
            # reflected light. Directions that moved with the exponent would miss what the horizon cuts off.
            h = _power_hemisphere(sample2, self._exponent(si, active))
            bs: Any = dr.zeros(mi.BSDFSample3f)
            bs.wo = mi.warp.square_to_cosine_hemisphere(sample2)
            bs.wo = dr.select(glossy, dr.detach(mi.reflect(si.wi, h)), bs.wo)
            bs.wo = dr.select(mirror, mi.reflect(si.wi), bs.wo)
            bs.eta = 1
            bs.sampled_component = dr.select(glossy, mi.UInt32(GLOSSY), mi.UInt32(DIFFUSE))
            bs.sampled_component = dr.select(mirror, mi.UInt32(MIRROR), bs.sampled_component)
            bs.sampled_type = dr.select(
                glossy, mi.UInt32(mi.BSDFFlags.GlossyReflection), mi.UInt32(mi.BSDFFlags.DiffuseReflection)
            )
            bs.sampled_type = dr.select(mirror, mi.UInt32(mi.BSDFFlags.DeltaReflection), bs.sampled_type)

            value, pdf = self.eval_pdf(ctx, si, bs.wo, smooth)
            bs.pdf = dr.select(mirror, prob_mirror, dr.detach(pdf))
            value = dr.select(mirror, self.mirror_reflectance.eval(si, mirror), value)
            weight = value / dr.select(bs.pdf > 0, bs.pdf, 1)  # a pdf of zero goes with a value of zero
            return bs, weight

        def eval_diffuse_reflectance(self, si: mi.SurfaceInteraction3f, active: Any = True) -> Any:
            return self.diffuse_reflectance.eval(si, active) * dr.pi

        def to_string(self) -> str:
            parameters = ",\n".join(f"{name} = {getattr(self, name)}" for name in PARAMETERS)
            return f"BlinnPhong[\n{textwrap.indent(parameters, '  ')}\n]"

        def _exponent(self, si: mi.SurfaceInteraction3f, active: Any) -> Any:
            # The first of equal channels: the checkerboard's eval_1() has its two values exchanged.
            return dr.clip(self.exponent.eval(si, active)[0], 0, MAX_EXPONENT)

        def _probabilities(self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, active: Any) -> Any:
            """Share out the samples among the components by what each reflects of a white sky.

            Detached: a choice by comparison has no derivative, so its probability may have none either.
            """

            def weight(component: int, flags: mi.BSDFFlags, reflectance: mi.Texture, albedo: Any) -> Any:
                if not ctx.is_enabled(flags, component):
                    return mi.Float(0)
                return dr.detach(mi.luminance(reflectance.eval(si, active), si.wavelengths) * albedo)

            p = self._exponent(si, active)
            weights = (
                weight(DIFFUSE, mi.BSDFFlags.DiffuseReflection, self.diffuse_reflectance, dr.pi),
                weight(GLOSSY, mi.BSDFFlags.GlossyReflection, self.specular_reflectance, 8 * dr.pi / (p + 2)),
                weight(MIRROR, mi.BSDFFlags.DeltaReflection, self.mirror_reflectance, 1),
            )
            total = sum(weights)
            return [w / dr.select(total > 0, total, 1) for w in weights]

    return BlinnPhong


PARAMETERS = (
    "diffuse_reflectance",
    "specular_reflectance",
    "mirror_reflectance",
    "ambient_reflectance",
    "exponent",
)


def _power_hemisphere(sample: mi.Point2f, p: Any) -> mi.Normal3f:
    """Warp the unit square to unit vectors h of density (p+1)/(2 pi) (n.h)^p about n = (0, 0, 1).

    cos theta = (1 - u)^(1/(p+1)). For a large p that is all but 1, so 1 - cos theta is computed
    instead, as -expm1(x) = 2 sinh(-x/2) exp(x/2) with x = log(1 - u)/(p+1), and sin theta from that.
    """
    x = 0.5 * dr.log(1 - sample.x) / (p + 1)
    one_minus_cos = 2 * dr.sinh(-x) * dr.exp(x)
    sin_theta = dr.sqrt(one_minus_cos * (2 - one_minus_cos))
    sin_phi, cos_phi = dr.sincos(dr.two_pi * sample.y)
    return mi.Normal3f(sin_theta * cos_phi, sin_theta * sin_phi, 1 - one_minus_cos)


def _variation(*textures: mi.Texture) -> int:
    """Mitsuba's flag for a component that depends on the place."""
    varies = any(texture.is_spatially_varying() for texture in textures)
    return int(mi.BSDFFlags.SpatiallyVarying if varies else mi.BSDFFlags.Empty)


def _reflectance(props: mi.Properties, name: str, default: float = 0.0) -> Any:
    """Read a number, a colour or a texture, all of whose values must lie in [0, 1]."""
    kinds = mi.Properties.Type
    given = props.type(name) if name in props else None
    literal = given in (kinds.Float, kinds.Integer, kinds.Color)
    if literal:  # before Mitsuba: it checks no <float>, and of a colour `mono` keeps only the luminance
        _check_range(props, name, props[name], 1)
    texture: Any = props.get_texture(name, default)
    if given is not None and not literal:
        for key, values in mi.traverse(texture):
            stored = key.split(".")[-1] in ("value", "data")  # of a constant, of a bitmap
            if stored and np.array(values).dtype != np.uint8:  # a byte as in the file stands for [0, 1]
                _check_range(props, name, values, 1)
    return texture


def _exponent(props: mi.Properties, name: str, default: float) -> Any:
    """Read a number from 0 to `MAX_EXPONENT`, or a texture, which is clamped where it is evaluated."""
    kinds = mi.Properties.Type
    given = props.type(name) if name in props else None
    if given in (kinds.Float, kinds.Integer):
        _check_range(props, name, props[name], MAX_EXPONENT)
    elif given not in (kinds.Object, None):
        raise SceneError(_refusal(props, name, props[name], "a number or a texture"))
    texture: Any = props.get_unbounded_texture(name, default)
    return texture


def _check_range(props: mi.Properties, name: str, given: Any, upper: float) -> None:
    values = np.ravel(np.array(given, dtype=np.float64))
    wrong = values[~((values >= 0) & (values <= upper))]  # so written, it holds NaN as well
    if wrong.size:
        raise SceneError(_refusal(props, name, wrong[0], f"from 0 to {upper:g}"))


def _refusal(props: mi.Properties, name: str, value: Any, allowed: str) -> str:
    return f"blinnphong `{props.id()}`: {name} is {value}, allowed is {allowed}"
