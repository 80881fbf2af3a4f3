"""A generated module, and its use in a process of its own."""

from commands import python

TEXT = """
@objective
def square(x, p, constants, gradient, scratch):
    return x[0] * x[0]


@kernel
def call(function, x):
    return function(x, x, x, x, x)
"""


def run_compiled(cache, before="", **environment):
    """Call a kernel in a process of its own: hits of its cache and of its argument's, stderr."""
    code = (
        f"{before}\n"
        "import numpy as np\n"
        "from casswarm.compiled import announce, generated_module\n"
        f"module = generated_module({TEXT!r})\n"
        "announce(module.call)\n"
        "assert module.call(module.square, np.array([2.0])) == 4.0\n"
        "print(sum(module.call.stats.cache_hits.values()), module.square.cache_hits)\n"
    )
    done = python("-W", "error", "-c", code, CASSWARM_CACHE=str(cache), **environment)
    return done.stdout.strip(), done.stderr
