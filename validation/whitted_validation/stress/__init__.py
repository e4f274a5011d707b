"""The stress suite: cases that break ray tracers, each with an outcome that is exactly known.

Every case is a statement about the picture's definition that holds whatever the arithmetic. It is put to several
policies of escaping one's own surface (`policies`): the textbook's fixed epsilon, Mitsuba's ``spawn_ray``, and the
plugin as it is. The truth comes from the reference tracer or from double precision, applied to the same
single-precision numbers, with a stated margin where a yes/no decision is too close to call.
"""
