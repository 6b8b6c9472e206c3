"""Files, checks of input, dotted paths, threads, command lines: what the rest of the package is built with."""
