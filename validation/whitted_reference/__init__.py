"""An independent plain-Python tracer of the picture that the plugins draw; standard library only."""
