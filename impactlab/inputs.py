"""What users give: arguments of public functions and fields of components, checked by their annotations."""

from __future__ import annotations

import collections.abc
import contextlib
import difflib
import functools
import importlib
import inspect
import itertools
import math
import os
import reprlib
import sys
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from numbers import Integral, Real
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, ParamSpec, TypeVar

import impactlab

if TYPE_CHECKING:
    import numpy as np

Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")

_SHOWN = reprlib.Repr()
_SHOWN.maxstring = _SHOWN.maxother = 100

_WHOLE = 2**63
"""Size of whole numbers from which on arrays cannot hold them."""

_LENGTH = 255
"""Bytes of the name of a file, or of a folder: file systems allow no more."""


def shown(value: Any) -> str:
    """Return a value as short text, whatever its own text does."""
    try:
        return _SHOWN.repr(value)
    except Exception:  # of the value's own class, or a whole number of thousands of digits
        return f"a value of type {type(value).__name__}"


def suggestion(name: object, known: Iterable[str]) -> str:
    """Return a clause that names the known name that is nearest to what was given, or all of them."""
    known = [str(item) for item in known]
    near = difflib.get_close_matches(str(name), known, n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    return f"allowed are {', '.join(map(repr, known))}" if known else "none is allowed here"


def known_name(kind: str, name: object, known: Iterable[str]) -> None:
    """Refuse a name that is unknown."""
    try:
        unknown = name not in known  # type: ignore[operator]
    except (TypeError, ValueError):  # it has no hash, or is an array
        unknown = True
    if unknown:
        raise impactlab.InvalidInput(f"There is no {kind} {shown(name)}; {suggestion(name, known)}")


def is_truth_value(value: Any) -> bool:
    """Whether a value is true or false, in Python's type or in NumPy's."""
    return type(value).__name__ == "bool"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, Real)) and not isinstance(value, bool)


def _is_whole(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _is_listed(value: Any) -> bool:
    """Whether a value is a list of others: neither text nor a mapping, nor an array without an axis."""
    if isinstance(value, (list, tuple)):
        return True
    if isinstance(value, (str, bytes, bytearray, Mapping, set)) or not isinstance(value, collections.abc.Collection):
        return False  # sets have no order
    return getattr(value, "ndim", 1) > 0


def finite(place: str, value: Any) -> float:
    """Return a finite float, or raise `InvalidInput` that names the place."""
    if not _is_number(value):
        uncertain = getattr(value, "is_uncertain", False) is True
        advice = "; il.uncertain takes functions of uncertain numbers." if uncertain else "."
        raise impactlab.InvalidInput(f"{place} must be a number, not {shown(value)}{advice}")
    try:
        number = float(value)
    except OverflowError:  # a whole number of hundreds of digits
        number = math.inf
    if not math.isfinite(number):
        raise impactlab.InvalidInput(f"{place} must be a finite number, not {shown(value)}.")
    return number


def positive(place: str, value: Any, units: str = "s") -> float:
    """Return a positive finite number, or raise `InvalidInput` that names it."""
    number = finite(place, value)
    if number <= 0.0:
        raise impactlab.InvalidInput(f"{place} must be larger than {f'0 {units}'.strip()}, not {shown(value)}.")
    return number


def whole(place: str, value: Any, least: int | None = None) -> int:
    """Return a whole number that is not too small, or raise `InvalidInput` that names it."""
    if _is_whole(value) and not -_WHOLE < value < _WHOLE:
        raise impactlab.InvalidInput(f"{place} must be a whole number of less than 2^63, not {shown(value)}.")
    if not _is_whole(value) or (least is not None and value < least):
        of_least = "" if least is None else f" of at least {least}"
        raise impactlab.InvalidInput(f"{place} must be a whole number{of_least}, not {shown(value)}.")
    return int(value)


def real_array(place: str, values: Any) -> np.ndarray:
    """Return an array of real numbers, or refuse it; they may be infinite or NaN."""
    import numpy as np  # studies are listed without it

    try:
        array = np.asarray(values)
        if array.dtype.kind not in "fiu" and not all(map(_is_number, array.ravel().tolist())):  # texts, dates, complex
            raise TypeError
        return array.astype(float, copy=False)
    except Exception:  # also of classes of others that say they are arrays
        raise _refused(place, "real numbers", values) from None


def finite_array(place: str, values: Any) -> np.ndarray:
    """Return an array of finite numbers, or refuse it."""
    import numpy as np  # studies are listed without it

    array = real_array(place, values)
    if not np.isfinite(array).all():
        raise impactlab.InvalidInput(f"{place} must hold finite numbers only.")
    return array


def of_one_shape(place: str, *arrays: np.ndarray) -> list[np.ndarray]:
    """Return arrays in the shape that they have in common, or refuse arrays that have none."""
    import numpy as np  # studies are listed without it

    try:
        return list(np.broadcast_arrays(*arrays))
    except ValueError:
        shapes = " and ".join(str(array.shape) for array in arrays)
        raise impactlab.InvalidInput(f"{place} takes numbers of one shape, not of the shapes {shapes}.") from None


FiniteNumbers = Annotated[Any, finite_array]
"""Finite numbers: one, or an array of any shape."""

Seconds = Annotated[float, positive]
"""A time larger than 0 (s)."""

Count = Annotated[int, functools.partial(whole, least=1)]
"""A whole number of at least 1."""


class Kind(NamedTuple):
    """A kind of values: its name, whether a value is meant to be of the kind, and the value that is then taken."""

    words: str
    meant: Callable[[Any], bool]
    taken: Callable[[str, Any], Any]
    of_type: bool = False
    """Whether the type of a value decides whether it is of the kind."""
    has_words: bool = False
    """Whether `taken` refuses all other values in words of its own."""

    def __call__(self, place: str, value: Any) -> Any:
        """Return a value as one of the kind, or refuse it."""
        if self.has_words or self.meant(value):
            return self.taken(place, value)
        raise _refused(place, self.words, value)


def as_it_is(place: str, value: Any) -> Any:
    """Return the value that was given."""
    return value


Text = Annotated[str, as_it_is]
"""Text that is no path where a path would do, too."""

ANYTHING = Kind("anything", lambda value: True, as_it_is)
"""Values that whoever uses them has to check."""

_NONE = Kind("None", lambda value: value is None, as_it_is, of_type=True)
NUMBER = Kind("a number", _is_number, finite, has_words=True)
_STRING = Kind("a string", lambda value: isinstance(value, str), as_it_is, of_type=True)


def _path(place: str, value: Any) -> Any:
    try:
        encoded = os.fsencode(value)
    except ValueError:
        encoded = b""
    if not encoded or b"\0" in encoded or max(map(len, encoded.split(os.sep.encode()))) > _LENGTH:
        raise _refused(place, "the path of a file or a folder", value)
    return value


_PATH = Kind("a path", lambda value: isinstance(value, str | os.PathLike), _path)

_PLAIN: dict[Any, Kind] = {
    Any: ANYTHING,
    object: ANYTHING,
    inspect.Parameter.empty: ANYTHING,
    None: _NONE,
    type(None): _NONE,
    float: NUMBER,
    int: Kind("a whole number", _is_whole, whole, has_words=True),
    bool: Kind("true or false", is_truth_value, lambda place, value: bool(value)),
    str: _STRING,
}
"""Kinds of values by annotations that have no parameters."""


def kind_of(annotation: Any) -> Kind:
    """Return the kind of values that an annotation describes."""
    origin, items = typing.get_origin(annotation), typing.get_args(annotation)
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    if origin is Annotated:
        kind = kind_of(items[0])
        if kind is ANYTHING:
            return Kind("numbers", _are_numbers, items[1], has_words=True)
        return kind._replace(taken=items[1], has_words=items[1] is not as_it_is)
    if origin in (typing.Union, types.UnionType):
        return _one_of([kind_of(item) for item in items])
    family = annotation if origin is None else origin
    if family is collections.abc.Callable:
        return Kind("a function", callable, as_it_is)
    if family in _GENERIC:
        return _GENERIC[family]([item if item is Ellipsis else kind_of(item) for item in items])
    if family is type and items:
        of = items[0]
        return Kind(
            f"a class of {_named(of)}", lambda value: isinstance(value, type) and issubclass(value, of), as_it_is
        )
    if not isinstance(family, type):  # a variable of types, or a form that is not known here
        return ANYTHING
    if getattr(family, "_is_protocol", False):
        needed = [name for name in vars(family) if not name.startswith("_")]
        words = _first_sentence(family)
        return Kind(
            words, lambda value: not isinstance(value, type) and all(hasattr(value, name) for name in needed), as_it_is
        )
    if (family.__module__, family.__name__) == ("numpy", "ndarray"):
        return Kind("an array of numbers", _are_numbers, real_array)
    return Kind(_named(family), lambda value: isinstance(value, family), as_it_is, of_type=True)


_PUBLIC = {"Composition": "Network", "Wall": "WALL"}
"""Public names of classes that have other ones, since layers below know no more."""


def _named(cls: type) -> str:
    name = _PUBLIC.get(cls.__name__, cls.__name__)
    name = f"il.{name}" if name in dir(impactlab) else name
    return f"{'an' if name[0].lower() in 'aeiou' else 'a'} {name}"


def _first_sentence(cls: type) -> str:
    """Return the first sentence of a docstring as words within another sentence."""
    text = " ".join((cls.__doc__ or cls.__name__).partition(".")[0].split()).replace("`", "")
    return text[0].lower() + text[1:]


def _many(kind: Kind) -> str:
    """Return the words for several values of a kind, nothing where they would be long."""
    one = kind.words.removeprefix("a ").removeprefix("an ")
    return "" if kind is ANYTHING or " " in one.removeprefix("whole ") else f"{one}s"


def _are_numbers(value: Any) -> bool:
    return _is_number(value) or _is_listed(value) or getattr(value, "ndim", None) == 0


def _one_of(kinds: list[Kind]) -> Kind:
    """Return the kind of values that are of one of several kinds."""
    if ANYTHING in kinds:
        return ANYTHING
    if any(kind is _PATH for kind in kinds):
        kinds = [kind for kind in kinds if kind is not _STRING]  # text is the path of a file
    needed = [kind for kind in kinds if kind is not _NONE]
    if len(needed) == 1:
        (one,) = needed
        return one._replace(
            meant=lambda value: value is None or one.meant(value),
            taken=lambda place, value: None if value is None else one(place, value),
        )
    *words, last = sorted((kind.words for kind in kinds), key=lambda item: item == "None")

    def taken(place: str, value: Any) -> Any:
        meant = [kind for kind in kinds if kind.meant(value)]
        for kind in meant[:-1]:
            with contextlib.suppress(impactlab.InvalidInput):
                return kind.taken(place, value)
        return meant[-1].taken(place, value)

    of_type = all(kind.of_type for kind in kinds)
    text = f"{', '.join(dict.fromkeys(words))} or {last}"
    return Kind(text, lambda value: any(kind.meant(value) for kind in kinds), as_it_is if of_type else taken, of_type)


def _refused(place: str, words: str, value: Any) -> impactlab.InvalidInput:
    return impactlab.InvalidInput(f"{place} must be {words}, not {shown(value)}.")


def _all_of_type(kind: Kind, values: Iterable[Any]) -> bool:
    """Whether values are all of a kind as their types tell, of which there are few."""
    return kind.of_type and all(map(kind.meant, {type(value): value for value in values}.values()))


def _mapping(kinds: list[Any]) -> Kind:
    """Return the kind of mappings from keys of one kind to values of another."""
    key, of = kinds or (ANYTHING, ANYTHING)

    def taken(place: str, value: Mapping[Any, Any]) -> Any:
        if key is not _STRING or not {str}.issuperset(map(type, value)):
            for name in value:
                key(f"{place}: a name", name)
        if of is not ANYTHING and not _all_of_type(of, value.values()):
            for name, item in value.items():
                of(f"{place}[{shown(name)}]", item)
        return value

    words = f"a mapping of names to {_many(of)}" if _many(of) else "a mapping"
    return Kind(words, lambda value: isinstance(value, Mapping), taken)


def _list(kinds: list[Any]) -> Kind:
    """Return the kind of lists, and of other collections, of items of a kind."""
    (of,) = kinds or (ANYTHING,)

    def taken(place: str, value: Any) -> Any:
        if of is NUMBER:
            _row(place, value)
        elif of is not ANYTHING and not _all_of_type(of, value):
            for index, item in enumerate(value):
                of(f"{place}[{index}]", item)
        return value

    return Kind(f"a list of {_many(of)}" if _many(of) else "a list", _is_listed, taken)


def _iterable(kinds: list[Any]) -> Kind:
    """Return the kind of lists, and of iterators, which are made lists."""
    listed = _list(kinds)

    def taken(place: str, value: Any) -> Any:
        return listed.taken(place, value if _is_listed(value) else list(value))

    return Kind(listed.words, lambda value: _is_listed(value) or isinstance(value, Iterator), taken)


def _row(place: str, value: Any) -> np.ndarray:
    """Return a list of numbers as an array."""
    row = finite_array(place, value if hasattr(value, "__array__") else list(value))
    if row.ndim != 1:
        raise _refused(place, "a list of numbers", value)
    return row


def _tuple(kinds: list[Any]) -> Kind:
    """Return the kind of tuples, of items of one kind or of a kind each; lists and arrays are made tuples."""
    each = kinds[0] if Ellipsis in kinds else None if kinds else ANYTHING
    words = f"({', '.join(kind.words for kind in kinds if kind is not Ellipsis)})"
    if each:
        words = _list([each]).words
    elif len(set(kinds)) == 1 and _many(kinds[0]):
        words = f"a list of {len(kinds)} {_many(kinds[0])}"

    def taken(place: str, value: Any) -> Any:
        if each is NUMBER:
            return tuple(_row(place, value).tolist())
        items = list(value)
        if each is None and len(items) != len(kinds):
            raise _refused(place, words, value)
        every = [each] * len(items) if each else kinds
        return tuple(
            kind(f"{place}[{index}]", item) for index, (kind, item) in enumerate(zip(every, items, strict=True))
        )

    return Kind(words, _is_listed, taken)


_GENERIC: dict[Any, Callable[[list[Any]], Kind]] = {
    collections.abc.Mapping: _mapping,
    collections.abc.Sequence: _list,
    collections.abc.Collection: _list,
    collections.abc.Iterable: _iterable,
    os.PathLike: lambda kinds: _PATH,
    dict: _mapping,
    list: _list,
    tuple: _tuple,
}
"""Kinds of values by annotations that may have parameters, whose kinds are given."""


class _Names(dict[str, Any]):
    """Names in annotations: of the module, and public ones, which modules may import for type checkers only."""

    def __missing__(self, name: str) -> Any:
        if name == "xr":
            return importlib.import_module("xarray")
        if name in dir(impactlab):
            return getattr(impactlab, name)
        raise KeyError(name)


def meaning_of(module: str, annotation: Any) -> Any:
    """Return what an annotation in a module means; `Any` where its names are not known."""
    if not isinstance(annotation, str):
        return annotation
    try:
        return eval(annotation, _Names(vars(sys.modules[module])))
    except Exception:  # of a class in a function, say
        return Any


class Checked:
    """A function behind a check of its arguments: their kinds by name, and their order by position."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        arguments = inspect.signature(function).parameters.values()
        self.title, self.kinds = function.__name__, dict[str, Kind]()
        self.positional, self.others = list[str](), ""
        self.defaults, self.takes_options = dict[str, Any](), False
        for item in arguments:
            self.kinds[item.name] = kind_of(meaning_of(function.__module__, item.annotation))
            if item.kind is item.VAR_POSITIONAL:
                self.others = item.name
            elif item.kind is item.VAR_KEYWORD:
                self.takes_options = True
            else:
                self.defaults[item.name] = item.default
                if item.kind is not item.KEYWORD_ONLY:
                    self.positional.append(item.name)
        self.of_class = self.positional[:1] in (["self"], ["cls"])
        self.needed = [item.name for item in arguments if item.default is item.empty and item.name in self.defaults]

    def __call__(self, *values: Any, **named: Any) -> Any:
        """Call the function with the arguments as they are taken, or refuse the call."""
        place = self._place(values)
        if wrong := self._wrong_names(len(values), named):
            raise impactlab.InvalidInput(f"{place}{wrong}")
        every = itertools.chain(self.positional, itertools.repeat(self.others))
        by_place = [self._one(place, name, value) for name, value in zip(every, values, strict=False)]
        return self.function(*by_place, **{name: self._one(place, name, value) for name, value in named.items()})

    def _place(self, values: tuple[Any, ...]) -> str:
        """Return the name of the function for messages, of a method with that of the class."""
        if not self.of_class or not values:
            return self.title
        owner = values[0] if isinstance(values[0], type) else type(values[0])
        return owner.__name__ if self.title == "__init__" else f"{owner.__name__}.{self.title}"

    def _one(self, place: str, name: str, value: Any) -> Any:
        kind = self.kinds.get(name, ANYTHING)
        if kind is ANYTHING or (name in self.defaults and value is self.defaults[name]):
            return value
        return kind(f"{place}: {name}", value)

    def _wrong_names(self, count: int, named: dict[str, Any]) -> str:
        """Say which arguments are unknown, too many or missing; nothing if none are."""
        if count > len(self.positional) and not self.others:
            return f" takes {len(self.positional) - self.of_class} values by position, not {count - self.of_class}."
        given = self.positional[:count]
        for name in named:
            if name in given:
                return f": {name} was given twice."
            if name not in self.defaults and not self.takes_options:
                return f" has no argument {name!r}; {suggestion(name, list(self.defaults)[self.of_class :])}"
        missing = [name for name in self.needed if name not in named and name not in given]
        return f" needs {', '.join(missing)}." if missing else ""


@typing.overload
def checked(entered: type[Returned]) -> type[Returned]: ...
@typing.overload
def checked(entered: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]: ...
def checked(entered: Any) -> Any:
    """Check arguments where they enter a function, or the public methods of a class, by the annotations.

    A value is taken as its annotation says: a number of NumPy as one of Python, a list as a tuple. Anything else is
    refused by an `InvalidInput` with the names of the function and of the argument, and the values that are allowed.
    """
    if isinstance(entered, type):
        for name, value in list(vars(entered).items()):
            if name == "__init__" or not name.startswith("_"):
                if isinstance(value, classmethod | staticmethod):
                    setattr(entered, name, type(value)(checked(value.__func__)))
                elif isinstance(value, types.FunctionType):
                    setattr(entered, name, checked(value))
        return entered
    first: list[Checked] = []

    @functools.wraps(entered)
    def with_checks(*values: Any, **named: Any) -> Any:
        if not first:  # not before the first call, when all names are there
            first.append(Checked(entered))
        return first[0](*values, **named)

    return with_checks
