"""Vehicles on a GPU, one thread each, from the kernels that the processor runs (extra `gpu`)."""
