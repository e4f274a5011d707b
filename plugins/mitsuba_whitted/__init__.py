"""Whitted's classic ray tracer for Mitsuba 3: integrator `whitted`, BSDF `blinnphong`, shape `polygon`."""

__version__ = "0.1.0"
