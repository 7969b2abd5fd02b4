"""Compilation of kernels: decorators, the disk cache, its name, arrays passed by pointer. No physics."""
