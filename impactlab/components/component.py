"""Components: frozen descriptions with validated fields and scalar kernels.

A component class declares its fields with :func:`parameter` and its physics as
*kernels*: static functions of scalars, without ``self``. Defining the class makes
it a frozen dataclass and checks the names of every kernel's arguments, so that a
mistake is reported where it was made and not when a simulation compiles.
"""

from __future__ import annotations

import dataclasses
import difflib
import dis
import functools
import inspect
import itertools
import math
import reprlib
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self, dataclass_transform

import numpy as np

import impactlab
from impactlab.errors import InvalidInput

UPDATE, ELAPSED = "update", "elapsed"
"""Kernel that returns the states of a law, and its argument of time: how long ago those that it takes were accepted."""

_POTENTIALS = "potential", "residual_potential"

_REGISTRY: dict[str, dict[str, type[Component]]] = {}


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return a clause that names the known name that is nearest to what was given, or all of them."""
    known = [str(item) for item in known]
    near = difflib.get_close_matches(str(name), known, n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    return f"allowed are {', '.join(map(repr, known))}" if known else "none is allowed here"


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    units: str = "1",
    minimum: float | None = None,
    above: float | None = None,
    maximum: float | None = None,
    kw_only: bool | dataclasses._MISSING_TYPE = dataclasses.MISSING,
) -> Any:
    """Declare a field of a component.

    Parameters
    ----------
    default : optional
        Value of the field when it is not given. Without it the field is required.
    units : str
        Units in the notation of UDUNITS, such as ``"N m-1"``.
    minimum, maximum : float, optional
        Smallest and largest value allowed.
    above : float, optional
        The value must be larger than this.
    kw_only : bool, optional
        Whether the field must be given by name. By default all fields but the
        first of a class must.

    Returns
    -------
    dataclasses.Field
    """
    metadata = {"units": units, "minimum": minimum, "above": above, "maximum": maximum}
    return dataclasses.field(default=default, metadata=metadata, kw_only=kw_only)  # type: ignore[call-overload]


def state(
    start: Any = dataclasses.MISSING,
    *,
    units: str = "1",
    minimum: float | None = None,
    above: float | None = None,
    maximum: float | None = None,
) -> Any:
    """Declare a state of a law: a number that each member has in each realization, and that the motion changes.

    It changes when a step is accepted, to what the kernel ``update`` of the law returns. The field of a
    component holds the value at the start, and is given by name.

    Parameters
    ----------
    start : float
        Value at the start of a run, unless a component is made with another.
    units : str
        Units in the notation of UDUNITS, such as ``"m"``.
    minimum, maximum, above : float, optional
        Limits of the value at the start, as of a `parameter`.

    Returns
    -------
    dataclasses.Field
    """
    metadata = {"units": units, "minimum": minimum, "above": above, "maximum": maximum, "state": True}
    return dataclasses.field(default=start, metadata=metadata, kw_only=True)


# Type checkers and editors see the fields. `parameter` is not named as a field specifier: a default that it takes by
# position would be unknown to them, and they would refuse correct programs. So they take every field for one with a
# default; a value that is missing, or given by position where a name is needed, is refused when the component is made.
@dataclass_transform(frozen_default=True)
class Component:
    """Base of oscillators, contact laws, excitations, integrators, records and studies.

    Subclasses become frozen dataclasses when they are defined. Two components are
    equal when they have the same class and the same values.
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Kernels of the family: name to kinematic arguments, in order."""

    required: ClassVar[tuple[str, ...]] = ()
    """Names of what a class must define; one without is abstract."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        _make_first_field_positional(cls)
        dataclasses.dataclass(frozen=True, kw_only=True, repr=False)(cls)
        for name, kinematic in cls.kernels.items():
            if name in cls.__dict__:
                _make_kernel(cls, name, kinematic)
        _check_states(cls)
        _REGISTRY.setdefault(cls.__name__, {})[cls.__module__] = cls

    def __new__(cls, /, *values: Any, **fields: Any) -> Self:
        missing = [name for name in cls.required if getattr(cls, name, None) is None]
        if missing:
            raise InvalidInput(
                f"{cls.__name__} is abstract: it does not define {', '.join(missing)}. "
                f"Use one of its subclasses or define {missing[0]} in one of your own."
            )
        _check_arguments(cls, values, fields)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for declared in _declared(type(self)):
            value = getattr(self, declared.name)
            valid = _validated(declared, value)
            if valid is not value:
                object.__setattr__(self, declared.name, valid)

    def __repr__(self) -> str:
        shown = [
            f"{field.name}={getattr(self, field.name)!r}"
            for field in dataclasses.fields(self)  # type: ignore[arg-type]
            if field.default is dataclasses.MISSING or getattr(self, field.name) != field.default
        ]
        return f"{type(self).__name__}({', '.join(shown)})"

    def __reduce__(self) -> Any:
        return _remake, (type(self), {name: getattr(self, name) for name in self.field_names()})

    @classmethod
    def field_names(cls) -> tuple[str, ...]:
        """Names of the fields, in the order of their declaration."""
        return tuple(declared.name for declared in _declared(cls))

    @classmethod
    def state_names(cls) -> tuple[str, ...]:
        """Names of the fields that are states, in the order of their declaration."""
        return tuple(declared.name for declared in _declared(cls) if declared.state)

    @classmethod
    def units(cls, name: str) -> str:
        """Units of a field."""
        fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
        return str(fields[name].metadata.get("units", "1"))

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def to_dict(self) -> dict[str, Any]:
        """Return the class name, with its module where several have one of that name, and the fields as plain data."""
        cls = type(self)
        alone = len(_REGISTRY[cls.__name__]) == 1
        fields = {name: _plain(getattr(self, name)) for name in self.field_names()}
        return {"type": cls.__name__ if alone else f"{cls.__module__}.{cls.__name__}", **fields}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make a component from what :meth:`to_dict` returned.

        The class is looked up by name among those of impactlab and those that are defined;
        nothing else is imported.

        Raises
        ------
        InvalidInput
            If the class is not defined, several have the name, or it belongs to another family.
        """
        if not isinstance(data, Mapping):
            raise InvalidInput(f"A {cls.__name__} is stored as a mapping, not {reprlib.repr(data)}.")
        fields = {str(key): value for key, value in data.items()}
        module, _, name = str(fields.pop("type", cls.__name__)).rpartition(".")
        found = [item for place, item in _REGISTRY.get(name, {}).items() if module in ("", place)]
        if not found and name in dir(impactlab):
            found = [item for item in [getattr(impactlab, name)] if isinstance(item, type)]  # its module is loaded now
        if not found:
            raise InvalidInput(
                f"No component class named {name!r} is defined; {suggestion(name, _REGISTRY)} "
                "Import the module that defines it first."
            )
        if len(found) > 1:
            places = ", ".join(item.__module__ for item in found)
            whole = f"{found[0].__module__}.{name}"
            raise InvalidInput(
                f"{name!r} is defined more than once ({places}); write {whole!r}, or rename one of them."
            )
        if not issubclass(found[0], cls):
            raise InvalidInput(f"{name!r} is not a {cls.__name__}.")
        return found[0](**fields)

    @classmethod
    def has_kernel(cls, name: str) -> bool:
        """Whether the class defines this kernel."""
        return callable(getattr(cls, name, None))

    @classmethod
    def arguments(cls, name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the names of the kinematic arguments that a kernel takes itself, and of its fields."""
        names = _argument_names(getattr(cls, name))
        kinematic = tuple(item for item in cls.kernels[name] if item in names)
        return kinematic, names[len(kinematic) :]

    @classmethod
    def kernel(cls, name: str) -> tuple[Callable[..., float], tuple[str, ...], tuple[str, ...]]:
        """Return a kernel with the names of its kinematic arguments and of its fields.

        A kernel that reads states reads those which hold at its own arguments: ``update`` has made them of the
        fields, at once.
        """
        kinematic, fields = cls.arguments(name)
        if name == UPDATE or set(fields).isdisjoint(cls.state_names()):
            return getattr(cls, name), kinematic, fields
        return _at_new_states(cls, name)

    def call(self, name: str, *kinematic: Any) -> np.ndarray:
        """Evaluate a kernel on arrays, in Python, with the fields filled in.

        Parameters
        ----------
        name : str
            Name of the kernel.
        *kinematic : array_like
            All kinematic arguments of the family's kernel, in order.

        Returns
        -------
        ndarray of float
        """
        function, used, fields = self.kernel(name)
        values = dict(zip(self.kernels[name], kinematic, strict=True))
        filled = [getattr(self, field) for field in fields]
        shape = np.broadcast_shapes(*(np.shape(value) for value in kinematic))
        arguments = [np.asarray(values[item], dtype=float) for item in used]

        def scalar(*point: float) -> float:
            try:
                return _number(function(*point, *filled))
            except OverflowError:
                raise  # infinite in compiled code; whoever asks for values far out decides what that means
            except (ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError) as error:
                place = ", ".join(f"{item} = {value:g}" for item, value in zip(used, point, strict=True))
                raise InvalidInput(
                    f"The kernel {type(self).__name__}.{name} failed for {self!r}{' at ' if place else ''}{place}: "
                    f"{type(error).__name__}: {error}."
                ) from error

        with np.errstate(over="ignore"):
            result = np.vectorize(scalar, otypes=[float])(*arguments) if arguments else np.float64(scalar())
        return np.broadcast_to(result, shape)


def call_each(components: Sequence[Component], name: str, *kinematic: np.ndarray) -> np.ndarray:
    """Evaluate a kernel of many components of any classes in Python, each on its row of arrays, (component, point).

    The arrays are all kinematic arguments of the family's kernel, in order. The result is NaN where a function of
    Python overflows or is not defined, which compiled ones do not tell.
    """
    result: np.ndarray = np.empty(np.broadcast_shapes(*(item.shape for item in kinematic)))
    by_class: dict[type[Component], list[int]] = {}
    for row, component in enumerate(components):
        by_class.setdefault(type(component), []).append(row)
    most = max(1, _POINTS // max(1, result.shape[1]))
    parts = [(cls, all_[k : k + most]) for cls, all_ in by_class.items() for k in range(0, len(all_), most)]
    for cls, rows in parts:
        function, used, fields = cls.kernel(name)
        values = dict(zip(cls.kernels[name], kinematic, strict=True))
        shape = len(rows), result.shape[1]
        columns = [np.broadcast_to(values[item], result.shape)[rows].ravel().tolist() for item in used]
        for field in fields:
            columns.append([value for row in rows for value in [getattr(components[row], field)] * shape[1]])
        points = zip(*columns, strict=True) if columns else itertools.repeat((), shape[0] * shape[1])
        try:
            result[rows] = np.fromiter(itertools.starmap(_without_overflow(function), points), float).reshape(shape)
        except (ArithmeticError, AttributeError, LookupError, NameError, TypeError):
            for row in rows:  # which says what is wrong, and where
                components[row].call(name, *(np.broadcast_to(item, result.shape)[row] for item in kinematic))
            raise
    return result


_POINTS = 1_000_000  # numbers of Python at a time, which take much memory


def _without_overflow(function: Callable[..., float]) -> Callable[..., float]:
    def guarded(*arguments: Any) -> float:
        try:
            value = function(*arguments)
        except (OverflowError, ValueError):  # as of math.sqrt
            return math.nan
        return value if type(value) is float else _number(value)

    return guarded


def _number(value: Any) -> float:
    """Return what a kernel returned as a float."""
    if value is None:
        raise TypeError("it returned None; every branch must return a number")
    if not isinstance(value, (*_NUMBERS, np.bool_)):
        raise TypeError(f"it returned {value!r}, not a number")
    return float(value)


def _at_new_states_of(cls: Any, name: str) -> tuple[Callable[..., float], tuple[str, ...], tuple[str, ...]]:
    """Return a kernel that reads states as `Component.kernel` does: those that hold just after a start."""
    (own, fields), (of_update, of_states) = cls.arguments(name), cls.arguments(UPDATE)
    kinematic = tuple(item for item in cls.kernels[name] if item in (*own, *of_update))
    used = tuple(dict.fromkeys((*fields, *of_states)))
    kernel, update, states = getattr(cls, name), getattr(cls, UPDATE), cls.state_names()

    def at_new_states(*values: Any) -> float:
        known = {**dict(zip((*kinematic, *used), values, strict=True)), ELAPSED: 0.0}
        new = update(*(known[item] for item in (*of_update, *of_states)))
        known.update(zip(states, (new,) if len(states) == 1 else new, strict=True))
        return kernel(*(known[item] for item in (*own, *fields)))  # type: ignore[no-any-return]

    return at_new_states, kinematic, used


_at_new_states: Callable[[Any, str], tuple[Callable[..., float], tuple[str, ...], tuple[str, ...]]]
_at_new_states = functools.cache(_at_new_states_of)


@functools.cache
def _argument_names(function: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters)


def _remake(cls: type[Component], fields: dict[str, Any]) -> Component:
    return cls(**fields)


def _make_first_field_positional(cls: type) -> None:
    """Let the first field that a class itself declares be given by position, unless all are said to be ``KW_ONLY``."""
    inherited = {name for base in cls.__mro__[1:] for name in inspect.get_annotations(base)}
    for name, kind in inspect.get_annotations(cls).items():
        if "KW_ONLY" in str(kind):
            return
        value = cls.__dict__.get(name, dataclasses.MISSING)
        if name in inherited or "ClassVar" in str(kind):
            continue
        if not isinstance(value, dataclasses.Field):
            value = dataclasses.field(default=value)
            setattr(cls, name, value)
        if value.kw_only is dataclasses.MISSING:
            value.kw_only = False
        return


def _make_kernel(cls: type[Component], name: str, kinematic: tuple[str, ...]) -> None:
    """Turn a bare function of the class body into a checked static method."""
    value = cls.__dict__[name]
    if value is None:
        return
    function = value.__func__ if isinstance(value, staticmethod) else value
    if not isinstance(function, types.FunctionType):
        raise InvalidInput(f"{cls.__name__}.{name} must be a plain function of scalars, not {value!r}.")
    place = f"{cls.__name__}.{name}"
    fields = cls.field_names()
    form = f"{name}({', '.join(kinematic)}, then fields by name)"
    arguments = inspect.signature(function).parameters
    for argument in arguments.values():
        if argument.kind is not argument.POSITIONAL_OR_KEYWORD or argument.default is not argument.empty:
            raise InvalidInput(f"{place}: {argument} is not a plain argument; write {form}.")
    names = list(arguments)
    for field in fields:
        if field in kinematic:
            raise InvalidInput(
                f"{cls.__name__}: the field {field!r} has the name of a kinematic argument of {name}; rename it."
            )
    if "self" in names:
        raise InvalidInput(
            f"{place} must not take self: a kernel is a function of scalars, {form}. "
            "Name the fields it needs as arguments."
        )
    for argument_name in names:
        if argument_name not in kinematic and argument_name not in fields:
            raise InvalidInput(
                f"{place} has an argument {argument_name!r} that is neither kinematic nor a field; "
                f"{suggestion(argument_name, (*kinematic, *fields))}"
            )
    used = [item for item in kinematic if item in names]
    if names[: len(used)] != used:
        raise InvalidInput(
            f"{place} takes ({', '.join(names)}); the kinematic arguments come first and in order: {form}."
        )
    if _may_end_without_value(function):
        what = "the states" if name == UPDATE else "a number"
        raise InvalidInput(f"{place} may end without a value: every branch must return {what}.")
    setattr(cls, name, staticmethod(function))


def _check_states(cls: type[Component]) -> None:
    """Refuse states without a start or without a kernel that updates them, and what has no meaning with states."""
    names, updates = cls.state_names(), getattr(cls, UPDATE, None) is not None
    if not names:
        if UPDATE in cls.kernels and updates:
            raise InvalidInput(f"{cls.__name__} defines {UPDATE}, but no state: declare name: float = il.state(0.0).")
        return
    some = ", ".join(names)
    if UPDATE not in cls.kernels:
        raise InvalidInput(
            f"{cls.__name__} cannot have states ({some}): laws of contacts and couplings, and oscillators can."
        )
    for declared in _declared(cls):
        if declared.state and (declared.needed or declared.kind != "float"):
            wrong = "has no start value" if declared.needed else f"is declared as {declared.kind}"
            raise InvalidInput(
                f"The state {declared.place} {wrong}: write {declared.name}: float = il.state(0.0, units=...)."
            )
    if not updates and all(getattr(cls, name, None) is not None for name in cls.required):
        form = f"{UPDATE}({', '.join(cls.kernels[UPDATE])}, then states and other fields by name)"
        raise InvalidInput(f"{cls.__name__} has states ({some}), but no {form}, which returns their new values.")
    for potential in _POTENTIALS:
        if getattr(cls, potential, None) is not None:
            raise InvalidInput(
                f"{cls.__name__} has states ({some}), so that its force depends on the past: it has no {potential}."
            )


def _may_end_without_value(function: types.FunctionType) -> bool:
    """Whether a function has a way to its end, or to a bare return, on which it returns None."""
    steps = [(step.opname, step.argval) for step in dis.get_instructions(function)]
    ways = [("LOAD_CONST", None), ("RETURN_VALUE", None)], [("RETURN_CONST", None)]  # by version of Python
    return any(steps[at : at + len(way)] == way for way in ways for at in range(len(steps)))


class _Declared(NamedTuple):
    """A field of a class, as it is looked at whenever a component is made."""

    name: str
    place: str
    kind: str
    positional: bool
    needed: bool
    state: bool
    units: str
    limits: tuple[float | None, float | None, float | None]  # minimum, above, maximum


def _fields_of(cls: Any) -> tuple[_Declared, ...]:
    result = []
    for field in dataclasses.fields(cls):
        kind = str(field.type if isinstance(field.type, str) else getattr(field.type, "__name__", field.type))
        needed = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        minimum, above, maximum = (field.metadata.get(name) for name in ("minimum", "above", "maximum"))
        units = field.metadata.get("units", "1")
        place = f"{cls.__name__}.{field.name}"
        remembered, limits = bool(field.metadata.get("state")), (minimum, above, maximum)
        result.append(_Declared(field.name, place, kind, not field.kw_only, needed, remembered, units, limits))
    return tuple(result)


_declared: Callable[[Any], tuple[_Declared, ...]] = functools.cache(_fields_of)


def _check_arguments(cls: type[Component], values: tuple[Any, ...], fields: dict[str, Any]) -> None:
    """Refuse unknown, surplus and missing arguments in the words of the component."""
    declared = _declared(cls)
    allowed = [item.name for item in declared]
    for name in fields:
        if name not in allowed:
            raise InvalidInput(f"{cls.__name__} has no field {name!r}; {suggestion(name, allowed)}")
    positional = [item.name for item in declared if item.positional]
    if len(values) > len(positional):
        raise InvalidInput(
            f"{cls.__name__} takes {len(positional)} value(s) by position, not {len(values)}; "
            f"name the others: {', '.join(allowed)}."
        )
    for item in declared:
        if item.needed and item.name not in fields and item.name not in positional[: len(values)]:
            raise InvalidInput(f"{cls.__name__} needs {item.name} ({item.units}).")


def _validated(declared: _Declared, value: Any) -> Any:
    """Return the value of a field in its declared type, or refuse it."""
    place, kind = declared.place, declared.kind
    if kind == "float":
        value = finite(place, value)
    elif kind == "int":
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
            raise InvalidInput(f"{place} must be a whole number, not {value!r}.")
        value = int(value)
    elif kind == "bool":
        if not isinstance(value, (bool, np.bool_)):
            raise InvalidInput(f"{place} must be true or false, not {value!r}.")
        value = bool(value)
    elif kind == "str":
        if not isinstance(value, str):
            raise InvalidInput(f"{place} must be a string, not {value!r}.")
    elif isinstance(value, list):
        value = tuple(value)
    for item in value if isinstance(value, tuple) else (value,):
        if isinstance(item, _NUMBERS) and not isinstance(item, bool):
            _check_limits(declared, item)
    return value


def _check_limits(declared: _Declared, value: Any) -> None:
    place, units = declared.place, "" if declared.units == "1" else f" {declared.units}"
    minimum, above, maximum = declared.limits
    finite(place, value)
    if minimum is not None and value < minimum:
        raise InvalidInput(f"{place} must be at least {minimum:g}{units}, not {value!r}.")
    if above is not None and value <= above:
        raise InvalidInput(f"{place} must be larger than {above:g}{units}, not {value!r}.")
    if maximum is not None and value > maximum:
        raise InvalidInput(f"{place} must be at most {maximum:g}{units}, not {value!r}.")


_NUMBERS = (int, float, np.number)


def finite(place: str, value: Any) -> float:
    """Return a finite float, or raise `InvalidInput` that names the place."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InvalidInput(f"{place} must be a number, not {value!r}.")
    try:
        number = float(value)
    except OverflowError:  # a whole number of hundreds of digits
        number = math.inf
    if not math.isfinite(number):
        raise InvalidInput(f"{place} must be a finite number, not {reprlib.repr(value)}.")
    return number


def _plain(value: Any) -> Any:
    if isinstance(value, Component):
        return value.to_dict()
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value


def positive(name: str, value: Any, units: str = "s") -> float:
    """Return a positive finite number, or raise `InvalidInput` that names it."""
    number = finite(name, value)
    if number <= 0.0:
        raise InvalidInput(f"{name} must be larger than 0 {units}, not {value!r}.")
    return number
