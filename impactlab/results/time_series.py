"""Measured time series from files, with their times and units."""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab.given_files import bytes_in, file_of
from impactlab.inputs import checked, shown
from impactlab.results.dataset import load

GRAVITY = 9.80665
"""Standard acceleration of gravity (m s-2)."""

_HEADING = 4
"""Lines before the values of a PEER file."""

_NUMBERS = r"NPTS\s*=\s*(\d+)\s*,\s*DT\s*=\s*([\d.E+-]+)", r"(\d+)\s+([\d.E+-]+)\s+NPTS\s*,\s*DT"
"""How the last of them gives the number of values and the time between them (s), in newer and in older files."""

_NUMBER = re.compile(r"\s*[+-]?(\.?\d|(nan|inf|infinity)\b)", re.IGNORECASE)
"""How a line of numbers begins; those before the first one are headings."""

_WORDS = re.compile(r"[^\W\d_eE]|^\s*[#%!]")
"""What a heading has, if it has digits: letters other than those of exponents, or the sign of a comment."""

_PLAIN = str.maketrans("−", "-", "\"'")
"""Turns a typographic minus sign into that of computers, and leaves out quotes."""


@checked
def read_time_series(path: str | os.PathLike[str]) -> xr.DataArray:
    """Read a measured time series from a file, for `SampledForce.from_dataarray`.

    Parameters
    ----------
    path : str or path
        An accelerogram of the PEER ground motion database, ``.AT2``; a netCDF file, ``.nc``, with one variable over
        one dimension, whose coordinate are the times; or any other text of two columns, times (s) and values, with
        commas, semicolons or spaces between them, quoted or not, and headings, if any, above.

    Returns
    -------
    (time,) DataArray
        Its coordinate ``time`` is in seconds. Accelerations of ``.AT2`` files are in m s-2, 9.80665 times what these
        hold; other values are what the file holds. The attribute ``heading`` has the lines above columns.

    Raises
    ------
    InvalidInput
        If the file does not exist, does not hold one series of two samples or more, a number is not finite, or times do
        not increase; the message names the file and the line.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "record.csv")
    ...     header = "time (s), acceleration (m s-2)"
    ...     np.savetxt(path, [[0.0, 0.0], [0.1, 1.5], [0.2, 0.0]], delimiter=",", header=header)
    ...     record = il.read_time_series(path)
    >>> record.values
    array([0. , 1.5, 0. ])
    """
    path = file_of(path)
    if path.suffix.lower() == ".nc":
        return _netcdf(path)
    raw = bytes_in(path)
    if raw[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        raise InvalidInput(f"{path} is a text in UTF-16; save it as UTF-8, or as CSV.")
    lines = raw.decode("utf-8-sig", errors="replace").splitlines()  # spreadsheets mark the byte order
    return _at2(path, lines) if path.suffix.lower() == ".at2" else _columns(path, lines)


def _series(
    path: Path, places: Sequence[str], times: np.ndarray, values: np.ndarray, attributes: dict[str, str]
) -> xr.DataArray:
    """Return a series whose samples are at some places of a file, or refuse it."""
    _check(path, places, times, values)
    return xr.DataArray(values, {"time": ("time", times, {"units": "s"})}, "time", attrs=attributes)


def _check(path: Path, places: Sequence[str], times: np.ndarray, values: np.ndarray) -> None:
    """Refuse samples that are too few or not finite, and times that do not increase."""
    if len(values) < 2:
        raise InvalidInput(
            f"{path} holds {len(values)} sample{'s' * (len(values) != 1)}; a time series has two at least, times (s) "
            "and values below any headings."
        )
    for name, numbers in (("time", times), ("value", values)):
        wrong = np.flatnonzero(~np.isfinite(numbers))
        if len(wrong):
            raise InvalidInput(
                f"{path}, {places[wrong[0]]}: the {name} is {numbers[wrong[0]]}, but all must be finite ({len(wrong)} "
                f"of {len(numbers)} are not); fill the gaps, or leave such samples out, before it is read."
            )
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if len(back):
        before, after = times[back[0] : back[0] + 2]
        raise InvalidInput(
            f"{path}, {places[back[0] + 1]}: the time {after:.10g} s follows {before:.10g} s, but times must increase; "
            "sort the samples, and keep one of each time."
        )


def _netcdf(path: Path) -> xr.DataArray:
    data = load(path)
    found = [item for item in data.data_vars.values() if item.ndim == 1 and item.dims[0] in item.coords]
    if len(found) != 1:
        raise InvalidInput(
            f"{path} holds {len(found)} variables of one dimension with a coordinate, not one; choose one with xarray."
        )
    times = found[0].dims[0]
    result = xr.DataArray(found[0].drop_vars(set(found[0].coords) - {times}).rename({times: "time"}))
    if result.dtype.kind in "fiu" and result.time.dtype.kind in "fiu":  # times of a calendar are not for us to judge
        _check(path, [f"sample {number} (from 0)" for number in range(len(result))], result.time.values, result.values)
    return result


def _at2(path: Path, lines: list[str]) -> xr.DataArray:
    heading = [line.strip().upper() for line in lines[:_HEADING]]
    numbers = [match for form in _NUMBERS if len(heading) == _HEADING and (match := re.search(form, heading[-1]))]
    if not numbers or "ACCELERATION" not in heading[2] or not heading[2].endswith("UNITS OF G"):
        raise InvalidInput(
            f"{path} does not begin as PEER's files of accelerations do: the third of four lines says "
            '"ACCELERATION TIME SERIES IN UNITS OF G", the fourth "NPTS= …, DT= … SEC".'
        )
    try:
        count, interval = int(numbers[0][1]), float(numbers[0][2])
    except ValueError:
        given = " and ".join(map(shown, numbers[0].groups()))
        raise InvalidInput(
            f"{path}, line {_HEADING}: NPTS must be a whole number and DT a number (s), not {given}."
        ) from None
    samples = [(f"line {line}", value) for line, row in _rows(path, lines, _HEADING) for value in row]
    places, values = zip(*samples, strict=True) if samples else ((), ())
    if len(values) != count:
        raise InvalidInput(f"{path} holds {len(values)} values, but its heading announces {shown(count)}.")
    if interval <= 0.0:
        raise InvalidInput(f"{path}, line {_HEADING}: the time between values must be above 0 s, not {interval:g} s.")
    attributes = {"units": "m s-2", "long_name": f"acceleration, {lines[1].strip()}"}
    return _series(path, places, interval * np.arange(count), GRAVITY * np.array(values), attributes)


def _columns(path: Path, lines: list[str]) -> xr.DataArray:
    plain = [line.translate(_PLAIN) for line in lines]
    heading = next((place for place, line in enumerate(plain) if _NUMBER.match(line)), len(lines))
    for place, line in enumerate(lines[:heading], 1):
        if re.search(r"\d", line) and not _WORDS.search(line):
            raise InvalidInput(
                f"{path}, line {place}: {line.strip()!r} has digits and no words, but is no row of numbers either; "
                "begin a heading with #, or mend the row."
            )
    rows = list(_rows(path, plain, heading))
    for place, row in rows:
        if len(row) != 2:
            raise InvalidInput(f"{path}, line {place}: a time and a value are needed, not {len(row)} numbers.")
    times, values = np.array([row for _, row in rows]).reshape(-1, 2).T
    above = "\n".join(line.strip() for line in lines[:heading] if line.strip())
    return _series(path, [f"line {place}" for place, _ in rows], times, values, {"heading": above} if above else {})


def _rows(path: Path, lines: list[str], heading: int) -> Iterator[tuple[int, list[float]]]:
    """Give the number of each line below a heading that is not empty, from 1, and the numbers in it."""
    for place, line in enumerate(lines[heading:], heading + 1):
        text = line.strip(",; \t")
        if ";" in text and "." not in text:  # numbers with decimal commas
            text = text.replace(",", ".")
        words = re.split(r"[,;\s]+", text)
        try:
            row = [float(word) for word in words if word]
        except ValueError:
            raise InvalidInput(f"{path}, line {place}: {line.strip()!r} holds more than numbers.") from None
        if row:
            yield place, row
