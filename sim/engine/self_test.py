"""A kernel with a known answer: shows that the engine compiles and computes on this machine."""

from rigtwin.sim.engine.backend import start, ti

TERMS = 100_000  # enough for every thread; all partial sums are whole numbers that float64 holds exactly


@ti.kernel
def _sum_of_squares(terms: ti.i32) -> ti.f64:
    total = 0.0
    for k in range(terms):
        total += ti.cast(k, ti.f64) ** 2
    return total


def engine_answer() -> tuple[bool, str, str]:
    """Start the engine in this process and compute a sum.

    Returns
    -------
    right : bool
        Whether the sum is right to the last digit.
    where : str
        Device and number of threads in words.
    cache : str
        Folder in which compiled kernels are kept.
    """
    backend = start()
    right = _sum_of_squares(TERMS) == (TERMS - 1) * TERMS * (2 * TERMS - 1) // 6
    note = f" ({backend.note})" if backend.note else ""
    where = f"{backend.device.upper()}, {backend.threads} threads{note}"
    return right, where, str(ti.lang.impl.current_cfg().offline_cache_file_path)
