"""The harness: the command line, the comparison of both tracers, and its reports."""
