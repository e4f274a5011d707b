"""The integrator `whitted`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted import film
from mitsuba_whitted.camera import Camera, any_ray
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.explain import explain
from mitsuba_whitted.plan import Plan, plan_of
from mitsuba_whitted.seen import PixelSeen
from mitsuba_whitted.stage import MIRRORS_SHARE, Settings, Stage
from mitsuba_whitted.textures import constant
from mitsuba_whitted.trace import Traced, trace

MOST_SAMPLES = 1 << 16
"""Samples a pixel: 256 x 256, where the grid's error has long met that of float32."""

Heard = Callable[[Any, Any, Any, Any], None]
"""Told of samples while they are traced: x, y (Float, pixels from the corner of the crop window), their rays of all
kinds (UInt32, the camera's included) and a mask.
"""

TERMS = ("ambient", "diffuse", "specular", "shadows", "mirrors")


def define() -> type[mi.SamplingIntegrator]:
    """Make the plugin class for the variant that is set, to be registered as ``whitted``."""

    class Whitted(mi.SamplingIntegrator):
        r"""
        .. _integrator-whitted:

        Whitted's classic ray tracer (:monosp:`whitted`)
        ------------------------------------------------

        .. pluginparameters::

         * - max_depth
           - |int|
           - Longest path in segments, counted as elsewhere in Mitsuba: 0 is black, 1 shows lamps and
             background, 2 adds lit surfaces, 3 lit surfaces in mirrors, and so on. -1 follows a mirror
             until it passes less than :math:`2^{-24}`, or for 1024 bounces. (Default: 10)

         * - ambient
           - |spectrum|
           - Ambient light :math:`I_a` that reaches every surface. (Default: 0)

         * - falloff
           - |string|
           - :monosp:`inverse_square`, as in nature and elsewhere in Mitsuba, or :monosp:`none`, the
             textbook's lights of constant strength. Concerns point and spot lights.
             (Default: :monosp:`inverse_square`)

         * - epsilon
           - |float|
           - World units, > 0: shadow and mirror rays ignore whatever lies nearer than this, on every
             shape. It is the textbook's remedy against rounding, here to be studied. (Default: unset;
             rays then start as far off as rounding demands at each point, and no further)

         * - target_error
           - |float|
           - Radiance, >= 0: pixels are refined until the picture's root mean square error is likely to be below
             this, whatever ``spp`` says; with max_depth -1 also mirrors are followed only as far as that takes.
             0 draws the n x n grid. Needs a box filter and a variant with Dr.Jit. (Default: 0)

         * - enable_ambient, enable_diffuse, enable_specular
           - |bool|
           - Whether that term of the model is added. (Default: |true|)

         * - enable_shadows, enable_mirrors
           - |bool|
           - Whether lights can be blocked; whether mirrors are followed. (Default: |true|)

         * - hide_emitters
           - |bool|
           - Must be |false|. (Default: |false|)

        The picture of the textbook (Whitted 1980; Shirley, Ashikhmin and Marschner, *Fundamentals of
        Computer Graphics*, 3rd ed., chapter 4): at each hit point

        .. math::

            c = k_a I_a + \sum_{\text{lights}} \left( k_d I \max(0, n \cdot l)
                + k_s I \max(0, n \cdot h)^p \right) + k_m \operatorname{raycolor}(p, r)

        where a light counts if it is above the horizon and nothing lies between. No random number is drawn:
        the same scene gives the same bytes, on any number of threads; ``seed`` changes nothing. With
        ``spp`` = n² the mean of an n x n grid in each pixel is taken; other numbers go to the next square.

        Lights are :monosp:`point`, :monosp:`directional` and :monosp:`spot`. Area lights are seen but light
        nothing; environment lights are the background. Materials are :monosp:`blinnphong`,
        :monosp:`diffuse`, :monosp:`conductor` with material :monosp:`none`, and :monosp:`twosided`.
        Anything else is refused by name. The variants are those that end in :monosp:`rgb` or
        :monosp:`mono`.

        .. tabs::
            .. code-tab:: xml

                <integrator type="whitted">
                    <integer name="max_depth" value="5"/>
                    <rgb name="ambient" value="0.1, 0.1, 0.15"/>
                </integrator>

            .. code-tab:: python

                'type': 'whitted',
                'max_depth': 5,
                'ambient': {'type': 'rgb', 'value': [0.1, 0.1, 0.15]}
        """  # noqa: D400 (a page of Mitsuba's manual starts with its label)

        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            self.settings = _settings(props)
            self._stage: Stage | None = None
            self._camera: Camera | None = None
            self._told: set[str] = set()

        def render(  # type: ignore[override]  # one signature where Mitsuba's stub has two
            self,
            scene: mi.Scene,
            sensor: mi.Sensor | int = 0,
            seed: int = 0,
            spp: int = 0,
            develop: bool = True,
            evaluate: bool = True,
            progress: film.Progress | None = None,
        ) -> mi.TensorXf:
            """Draw the scene, and leave the picture in the sensor's film as well.

            Parameters
            ----------
            scene, sensor
                The scene; the sensor or its number in the scene.
            seed : int
                Unused: nothing here is random.
            spp : int
                Samples a pixel, 0 for those of the sensor's sampler; a number that is no square becomes the next.
            develop : bool
                Whether to return the picture, or an empty tensor.
            evaluate : bool
                Whether to wait for the picture, or to return while it is still being drawn.
            progress
                Called with the rows done and the rows in all, again and again.

            Returns
            -------
            TensorXf
                (height, width, channels), float32, linear.

            Raises
            ------
            SceneError
                If the scene cannot be drawn as it is defined.
            """
            sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
            stage, camera, plan = self._prepare(scene, sensor)

            def draw(x: Any, y: Any, active: Any) -> tuple[Any, Any]:
                traced = trace(stage, plan, camera.rays(x, y), active)
                return traced.colour, traced.hit

            def look(x: Any, y: Any, active: Any) -> tuple[Any, Any]:
                traced = trace(stage, plan, camera.rays(x, y), active)
                return _four_channels(traced), traced.path

            with dr.suspend_grad():  # type: ignore[no-untyped-call]
                if self.settings.target_error:
                    picture = film.expose_to(sensor.film(), self._pixel_error(), look, progress)
                else:
                    picture = film.expose(sensor.film(), self._grid(sensor, spp), draw, progress)
            if evaluate:
                dr.sync_thread()
            return picture if develop else mi.TensorXf()

        def render_in_bands(
            self, scene: mi.Scene, sensor: mi.Sensor | int = 0, spp: int = 0
        ) -> Iterator[tuple[int, NDArray[np.float32]]]:
            """Draw band by band, for pictures larger than memory: number of the first row, and (rows, width, channels).

            The bytes are those of `render`; the film is left alone.
            """
            if self.settings.target_error:
                raise SceneError("target_error cannot be drawn band by band; set it to 0")
            sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
            stage, camera, plan = self._prepare(scene, sensor)

            def draw(x: Any, y: Any, active: Any) -> tuple[Any, Any]:
                with dr.suspend_grad():  # type: ignore[no-untyped-call]
                    traced = trace(stage, plan, camera.rays(x, y), active)
                return traced.colour, traced.hit

            yield from film.expose_in_bands(sensor.film(), self._grid(sensor, spp), draw)

        def sample(
            self, scene: mi.Scene, sampler: mi.Sampler, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            """Follow a single ray, for integrators such as `aov` that wrap another; the sampler is not asked.

            Scalar variants come here once a sample: there, only `render` looks for edits. They must do it from
            a single thread, since Mitsuba takes a second call of the same object for a call of its base class.
            """
            stage = self._set(scene, edits=bool(dr.is_jit_v(mi.Float)))
            traced = trace(stage, plan_of(stage), any_ray(ray, stage.surfaces.origin), active)
            return traced.colour, traced.hit, []

        def plan(self, scene: mi.Scene, sensor: mi.Sensor | int = 0) -> Plan:
            """Say what the kernel for `scene` holds, seen by this sensor."""
            if not scene.sensors():
                return plan_of(self._set(scene))
            return self._prepare(scene, scene.sensors()[sensor] if isinstance(sensor, int) else sensor)[2]

        def explain(self, scene: mi.Scene, x: int, y: int, sensor: mi.Sensor | int = 0, spp: int = 0) -> PixelSeen:
            """Say how pixel (x, y) of the picture came about: every ray, cosine and colour; `spp` as in `render`."""
            sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
            width, height = (int(size) for size in sensor.film().crop_size())
            if not (0 <= x < width and 0 <= y < height):
                raise SceneError(f"pixel ({x}, {y}) is not in the picture of {width} x {height} pixels")
            stage, camera, plan = self._prepare(scene, sensor)
            return explain(stage, plan, camera.rays, x, y, self._grid(sensor, spp))

        def count_rays(
            self, scene: mi.Scene, sensor: mi.Sensor | int = 0, spp: int = 0, heard: Heard | None = None
        ) -> dict[str, int]:
            """Count the rays of a picture by tracing it once more: `camera`, `mirror` and `shadow` rays.

            With a target error also `cut` ones: mirrors that were not followed since they would add too little; and
            `heard` is told where the samples are, and the rays of each.
            """
            sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
            stage, camera, plan = self._prepare(scene, sensor)
            if self.settings.target_error:
                tally = dr.zeros(mi.UInt64, 4)

                def look(x: Any, y: Any, active: Any) -> tuple[Any, Any]:
                    traced = trace(stage, plan, camera.rays(x, y), active)
                    counts = active & (x > -dr.inf)  # as wide as the samples: a constant counts once for all of them
                    one = mi.UInt32(1)
                    if heard:
                        heard(x, y, one + traced.mirror_rays + traced.shadow_rays, counts)
                    for i, rays in enumerate((one, traced.mirror_rays, traced.shadow_rays, traced.cut_rays)):
                        dr.scatter_add(tally, mi.UInt64(rays), mi.UInt32(i), counts)
                    return _four_channels(traced), traced.path

                film.expose_to(sensor.film(), self._pixel_error(), look)
                return dict(zip(("camera", "mirror", "shadow", "cut"), map(int, tally), strict=True))

            n = self._grid(sensor, spp)

            def count(x: Any, y: Any, active: Any) -> tuple[Any, Any]:
                traced = trace(stage, plan, camera.rays(x, y), active)
                return traced.mirror_rays, traced.shadow_rays

            mirror, shadow = film.totals(sensor.film(), n, count)
            return {"camera": math.prod(sensor.film().crop_size()) * n * n, "mirror": mirror, "shadow": shadow}

        def aov_names(self) -> list[str]:
            """No channels besides colour."""
            return []

        def to_string(self) -> str:
            """Name the parameters."""
            lines = (f"  {name} = {value}" for name, value in dataclasses.asdict(self.settings).items())
            return "Whitted[\n" + ",\n".join(lines) + "\n]"

        def _prepare(self, scene: mi.Scene, sensor: mi.Sensor) -> tuple[Stage, Camera, Plan]:
            stage = self._set(scene)
            if self._camera is None or not self._camera.follows(sensor, stage.surfaces.centre):
                self._camera = Camera(sensor, stage.surfaces.centre)
            return stage, self._camera, plan_of(stage, self._camera)

        def _set(self, scene: mi.Scene, edits: bool = True) -> Stage:
            if self._stage is not None and self._stage.follows(scene):
                if edits:
                    self._stage.refresh(self.settings)
            else:
                self._stage = Stage(scene, self.settings)
            for name in self._stage.lights_nothing:
                self._tell_once(f"{name} is drawn where it is seen, but lights no surface")
            return self._stage

        def _pixel_error(self) -> float:
            """Tell what is left of the target error once mirrors that are not followed have had their share."""
            return self.settings.target_error * (1 - MIRRORS_SHARE if self.settings.max_depth < 0 else 1)

        def _grid(self, sensor: mi.Sensor, spp: int) -> int:
            spp = spp or sensor.sampler().sample_count()
            if not 0 < spp <= MOST_SAMPLES:
                raise SceneError(f"{spp} samples a pixel are out of range; allowed are 1 to {MOST_SAMPLES}")
            n: int = math.isqrt(spp - 1) + 1
            if n * n != spp:
                self._tell_once(f"{spp} samples a pixel are no square: {n} x {n} are taken")
            return n

        def _tell_once(self, message: str) -> None:
            if message not in self._told:
                self._told.add(message)
                mi.Log(mi.LogLevel.Warn, message)  # type: ignore[operator]  # its stub takes it for an object

    return Whitted


def _four_channels(traced: Traced) -> mi.Vector4f:
    """Three colour channels, all alike in a mono variant, and the alpha."""
    red, green, blue = traced.colour if len(traced.colour) == 3 else [traced.colour.x] * 3
    return mi.Vector4f(red, green, blue, dr.select(traced.hit, mi.Float(1), mi.Float(0)))


def _settings(props: Any) -> Settings:
    """Read and check the parameters of the integrator."""
    name = f"integrator `{props.id()}`"
    if props.get("hide_emitters", False):
        raise SceneError(f"{name}: hide_emitters must be false")
    ambient = constant(props.get_unbounded_texture("ambient", 0.0))
    if ambient is None:
        raise SceneError(f"{name}: ambient must be one colour, not a texture")
    epsilon = float(props["epsilon"]) if "epsilon" in props else None
    falloff = str(props.get("falloff", "inverse_square"))
    target_error = float(props.get("target_error", 0.0))
    enabled = {f"enable_{term}": bool(props.get(f"enable_{term}", True)) for term in TERMS}
    try:
        return Settings(props.get("max_depth", 10), tuple(ambient), falloff, epsilon, target_error, **enabled)
    except SceneError as error:
        raise SceneError(f"{name}: {error}") from None
