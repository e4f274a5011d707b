"""Whitted's classic ray tracer for Mitsuba 3: integrator `whitted`, BSDF `blinnphong`, shape `polygon`.

Import it before Mitsuba, so that it can choose the libLLVM that Dr.Jit compiles with; it needs no variant::

    import mitsuba_whitted
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    image = mi.render(mi.load_file("scene.xml"))
"""

from mitsuba_whitted.registration import LIBLLVM, follow_variants, register

__version__ = "0.1.0"
__all__ = ["LIBLLVM", "register"]

follow_variants()
