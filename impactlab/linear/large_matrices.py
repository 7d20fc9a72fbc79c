"""Dense algebra for hundreds of bodies: in blocks, and on another thread, so that signals are answered meanwhile."""

from __future__ import annotations

import contextvars
import ctypes
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

import numpy as np

Result = TypeVar("Result")

LARGE = 256
"""Rows from which on matrices are worked on here: below, each call of LAPACK takes some hundredths of a second."""

_SMALL = 64
"""Rows of the blocks in which a triangular equation is solved entry by entry: LAPACK does so with all of it, and takes
20 times as long for 2000 rows as products of blocks."""


def answered(function: Callable[..., Result], *arguments: Any) -> Result:
    """Return the result of a function that leaves the interpreter to other threads, such as those of `numpy.linalg`.

    The main thread alone answers signals. An error that one raises leaves the other thread to end by itself.
    """
    if threading.current_thread() is not threading.main_thread():
        return function(*arguments)
    found: Future[Result] = Future()

    def run() -> None:
        try:
            found.set_result(function(*arguments))
        except BaseException as error:
            found.set_exception(error)

    context = contextvars.copy_context()  # which has NumPy's handling of floating-point errors
    threading.Thread(target=context.run, args=(run,), daemon=True).start()
    while not found.done():
        wait([found], 0.1)  # on some systems no signal ends a longer one
    return found.result()


def eigh(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the eigenvalues and eigenvectors of a symmetric matrix."""
    values, vectors = answered(np.linalg.eigh, matrix) if len(matrix) > LARGE else np.linalg.eigh(matrix)
    return values, vectors


def eigenvalues(matrix: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of a matrix."""
    return np.asarray(answered(np.linalg.eigvals, matrix) if len(matrix) > LARGE else np.linalg.eigvals(matrix))


def schur(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return T and R of ``matrix = R T Rᵀ``, T being triangular but for blocks of two rows, and R orthogonal."""
    from scipy import linalg

    return answered(_schur, matrix) if len(matrix) > LARGE else linalg.schur(matrix)


def lyapunov_solution(drift: np.ndarray, growth: np.ndarray) -> np.ndarray:
    """Solve ``drift P + P driftᵀ + growth = 0``."""
    if len(drift) <= LARGE:
        from scipy import linalg  # loaded only where there are couplings

        return np.asarray(linalg.solve_continuous_lyapunov(drift, -growth))
    triangle, turned = schur(drift)
    return np.asarray(turned @ _sylvester(triangle, triangle, -turned.T @ growth @ turned) @ turned.T)


def _sylvester(left: np.ndarray, right: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Solve ``left P + P rightᵀ = given``, both being triangular but for blocks of two rows, by halves.

    The method is that of I. Jonsson and B. Kågström, ACM Trans. Math. Softw. 28, 2002, 392.
    """
    if max(given.shape) <= _SMALL:
        from scipy.linalg import lapack

        result, scale, _ = lapack.dtrsyl(left, right, given, tranb="T")
        return np.asarray(result / scale)
    result = np.empty_like(given)
    if len(left) >= len(right):
        half = _half(left)
        result[half:] = _sylvester(left[half:, half:], right, given[half:])
        result[:half] = _sylvester(left[:half, :half], right, given[:half] - left[:half, half:] @ result[half:])
    else:
        half = _half(right)
        result[:, half:] = _sylvester(left, right[half:, half:], given[:, half:])
        more = given[:, :half] - result[:, half:] @ right[:half, half:].T
        result[:, :half] = _sylvester(left, right[:half, :half], more)
    return result


def _half(triangle: np.ndarray) -> int:
    """Return where to cut a matrix that is triangular but for blocks of two rows, near its middle."""
    half = len(triangle) // 2
    return half + int(triangle[half, half - 1] != 0.0)


def _schur(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Call LAPACK's ``dgees`` as SciPy does, but without the interpreter's lock, which SciPy keeps."""
    from scipy.linalg import cython_lapack

    python, item, text, place = ctypes.pythonapi, ctypes.py_object, ctypes.c_char_p, ctypes.c_void_p
    name = ctypes.PYFUNCTYPE(text, item)(("PyCapsule_GetName", python))
    address = ctypes.PYFUNCTYPE(place, item, text)(("PyCapsule_GetPointer", python))
    capsule = cython_lapack.__pyx_capi__["dgees"]
    dgees = ctypes.CFUNCTYPE(None, *[place] * 15)(address(capsule, name(capsule)))
    size, room = len(matrix), 40 * len(matrix)  # work for blocks of LAPACK's usual size
    triangle, turned = np.array(matrix, dtype=float, order="F"), np.empty((size, size), order="F")
    rates, work, none = np.empty((2, size)), np.empty(room), ctypes.c_int(0)
    rows, length, failed = (ctypes.c_int(item) for item in (size, room, 0))
    dgees(
        b"V", b"N", None, ctypes.byref(rows), triangle.ctypes.data, ctypes.byref(rows), ctypes.byref(none),
        rates[0].ctypes.data, rates[1].ctypes.data, turned.ctypes.data, ctypes.byref(rows), work.ctypes.data,
        ctypes.byref(length), None, ctypes.byref(failed),
    )  # fmt: skip
    if failed.value:
        raise np.linalg.LinAlgError(f"The Schur form of a matrix of {size} rows was not found.")
    return triangle, turned
