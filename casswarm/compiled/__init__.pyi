from .folders import cache_folder, private_folder
from .kernels import (
    Kernel,
    allocating_kernel,
    announce,
    contiguous,
    generated_module,
    kernel,
    objective,
    reordering_kernel,
    specialised,
)
from .parallel import execute

__all__ = [
    "Kernel",
    "allocating_kernel",
    "announce",
    "cache_folder",
    "contiguous",
    "execute",
    "generated_module",
    "kernel",
    "objective",
    "private_folder",
    "reordering_kernel",
    "specialised",
]
