"""Vehicles on a GPU, one thread each, with the kernels of the processor (extra `gpu`)."""
