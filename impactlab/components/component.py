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
import operator
import types
import typing
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self, dataclass_transform

import impactlab
from impactlab.components.descriptions import of_numbers
from impactlab.components.evaluation import (
    ERRORS,
    NUMBERS,
    TIME,
    UPDATE,
    Found,
    at_new_states,
    by_name,
    floats_of,
    number_of,
)
from impactlab.components.fields import Declared, declared_by, make_first_field_positional
from impactlab.components.offered import load_offered, offered_names
from impactlab.errors import InvalidInput
from impactlab.inputs import ANYTHING, NUMBER, Kind, checked, finite, kind_of, meaning_of, shown, suggestion

if TYPE_CHECKING:
    import numpy as np

SHOWN = 6
"""Items of a list that a text shows: where there are more, it says how many."""

_POTENTIALS = {"potential": "force", "residual_potential": "residual"}
"""Kernels of potentials, and of the forces that they are integrals of."""

_LIMITS = {
    "minimum": ("at least", operator.lt),
    "above": ("larger than", operator.le),
    "maximum": ("at most", operator.gt),
}
"""Limits of a value: what it must be, and when it is not."""

_REGISTRY: dict[str, dict[str, type[Component]]] = {}


# Type checkers and editors see the fields. `parameter` is not named as a field specifier: a default that it takes by
# position would be unknown to them, and they would refuse correct programs. So they take every field for one with a
# default; a value that is missing, or given by position where a name is needed, is refused when the component is made.
@dataclass_transform(frozen_default=True)
class Component:
    """Base of oscillators, contact laws, excitations, integrators, records and studies.

    Subclasses become frozen dataclasses when they are defined. Two components are
    equal when they have the same class and the same values.

    Examples
    --------
    >>> spring = il.LinearContact(100.0)
    >>> spring.replace(stiffness=200.0)
    LinearContact(stiffness=200.0)
    >>> spring.to_dict()
    {'type': 'LinearContact', 'stiffness': 100.0}
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Kernels of the family: name to kinematic arguments, in order."""

    citation: ClassVar[str] = ""
    """What to cite where the class is used, entries of BibTeX with empty lines between them; not inherited."""

    required: ClassVar[tuple[str, ...]] = ()
    """Names of attributes and methods that a class must define; one without is abstract."""

    is_uncertain: ClassVar[bool] = False
    """Whether a number in it is an `impactlab.Uncertain`, so that it describes many components."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.citation = cls.__dict__.get("citation", "")
        _check_annotations(cls)
        make_first_field_positional(cls)
        if "__post_init__" in cls.__dict__:
            cls.__post_init__ = of_numbers(cls.__post_init__)  # type: ignore[method-assign]
        dataclasses.dataclass(frozen=True, kw_only=True, repr=False)(cls)
        for name, kinematic in cls.kernels.items():
            if name in cls.__dict__:
                _make_kernel(cls, name, kinematic)
        _check_states(cls)
        _check_potentials(cls)
        _REGISTRY.setdefault(cls.__name__, {})[cls.__module__] = cls

    def __new__(cls, /, *values: Any, **fields: Any) -> Self:
        if missing := undefined(cls):
            raise InvalidInput(
                f"{cls.__name__} is abstract: it does not define {', '.join(missing)}. "
                f"Use one of its subclasses or define {missing[0]} in one of your own."
            )
        _check_arguments(cls, values, fields)
        return super().__new__(cls)

    @of_numbers
    def __post_init__(self) -> None:
        for declared, kind in zip(declared_by(type(self)), _kinds(type(self)), strict=True):
            value = getattr(self, declared.name)
            valid = _validated(declared, kind, value)
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
        return _names(cls)[0]

    @classmethod
    def state_names(cls) -> tuple[str, ...]:
        """Names of the fields that are states, in the order of their declaration."""
        return _names(cls)[1]

    @classmethod
    def units_of(cls, name: str) -> str:
        """Units of a field."""
        return {declared.name: declared.units for declared in declared_by(cls)}[name]

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def to_dict(self) -> dict[str, Any]:
        """Return the class name, with its module where several have one of that name, and the fields as plain data."""
        return {"type": self.stored_name(), **{name: plain(getattr(self, name)) for name in self.field_names()}}

    @classmethod
    def stored_name(cls) -> str:
        """Return the name of the class, with its module where several have one of that name."""
        alone = len(classes_named(cls.__name__)) == 1
        return cls.__name__ if alone else f"{cls.__module__}.{cls.__name__}"

    @classmethod
    @checked
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make a component from what :meth:`to_dict` returned.

        The class is looked up by name among those of impactlab, those that are defined, and those that an
        installed distribution offers by an entry point of its name in the group ``impactlab.components``;
        nothing else is imported.

        Raises
        ------
        InvalidInput
            If the class is not defined, several have the name, it belongs to another family, or what a distribution
            offers cannot be used.
        """
        fields = {str(key): value for key, value in data.items()}
        module, _, name = str(fields.pop("type", cls.__name__)).rpartition(".")
        found = [item for place, item in classes_named(name).items() if module in ("", place)]
        if not found:
            near = difflib.get_close_matches(name, {*_REGISTRY, *dir(impactlab), *offered_names()}, n=1)
            advice = f"did you mean {near[0]!r}?" if near else "import the module that defines it first."
            raise InvalidInput(f"No component class named {name!r} is defined; {advice}")
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
        return _arguments(getattr(cls, name), cls.kernels[name])

    @classmethod
    def kernel(cls, name: str) -> Found:
        """Return a kernel with the names of its kinematic arguments and of its fields.

        A kernel that reads states reads those which hold at its own arguments: ``update`` has made them of the
        fields, at once.
        """
        return _found(cls, name, getattr(cls, name), getattr(cls, UPDATE, None))

    def call(self, name: str, *kinematic: Any) -> np.ndarray:
        """Evaluate a kernel on arrays, in Python, with the fields filled in.

        Parameters
        ----------
        name : str
            Name of the kernel.
        *kinematic : array_like
            All kinematic arguments of the family's kernel, in order; the time may be left out, and is 0 then.

        Returns
        -------
        ndarray of float
        """
        import numpy as np  # studies are listed without it

        function, used, fields = self.kernel(name)
        values = by_name(self.kernels[name], kinematic)
        filled = [getattr(self, field) for field in fields]
        shape = np.broadcast_shapes(*(np.shape(value) for value in kinematic))
        arguments = [np.asarray(values[item], dtype=float) for item in used]

        def scalar(*point: float) -> float:
            try:
                value = function(*point, *filled)
                return value if type(value) is float else number_of(value)
            except OverflowError:
                raise  # infinite in compiled code; whoever asks for values far out decides what that means
            except ERRORS as error:
                place = ", ".join(f"{item} = {value:g}" for item, value in zip(used, point, strict=True))
                raise InvalidInput(
                    f"The kernel {type(self).__name__}.{name} failed for {self!r}{' at ' if place else ''}{place}: "
                    f"{type(error).__name__}: {error}."
                ) from error

        of_arguments = np.broadcast_shapes(*(item.shape for item in arguments))
        columns = [np.broadcast_to(item, of_arguments).ravel().tolist() for item in arguments]
        with np.errstate(over="ignore"):  # of kernels with functions of NumPy
            number = len(columns[0]) if columns else 1
            floats = floats_of(function, [*columns, *([value] * number for value in filled)])
            if floats is None:
                floats = [scalar(*point) for point in (zip(*columns, strict=True) if columns else [()])]
            found = np.array(floats, dtype=float)
        return np.broadcast_to(found.reshape(of_arguments), shape)


def classes_named(name: str) -> dict[str, type[Component]]:
    """Return the classes of a name by their modules, also the bundled one whose module nobody has needed yet."""
    _load_bundled(name)
    if name not in _REGISTRY and (problem := load_offered(name)):
        raise InvalidInput(problem)
    return _REGISTRY.get(name, {})


@functools.cache
def _load_bundled(name: str) -> None:
    """Load the module of a bundled class, if there is one of that name."""
    if name in dir(impactlab):
        getattr(impactlab, name)


def take_part(owner: Component, field: str, family: type[Component], example: str) -> None:
    """Refuse a field that is no component of a family; it may be given as data."""
    value = getattr(owner, field)
    if isinstance(value, Mapping):
        value = family.from_dict(value)
        object.__setattr__(owner, field, value)
    if not isinstance(value, family):
        raise InvalidInput(f"{type(owner).__name__}.{field} must be {example}, not {shown(value)}.")


def _remake(cls: type[Component], fields: dict[str, Any]) -> Component:
    return cls(**fields)


def plain(value: Any) -> Any:
    """Return a component, or the value of a field, as plain data."""
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    to_dict = getattr(value, "to_dict", None)
    return value if to_dict is None else to_dict()


@functools.cache
def _arguments(function: Callable[..., Any], kinematic: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return which kinematic arguments a kernel takes, and its other arguments."""
    names = tuple(inspect.signature(function).parameters)
    own = tuple(item for item in kinematic if item in names)
    return own, names[len(own) :]


def _found_of(cls: Any, name: str, function: Callable[..., float], update: Any) -> Found:
    """Return the result of `Component.kernel` for a class with these kernels."""
    kinematic, fields = cls.arguments(name)
    if name == UPDATE or set(fields).isdisjoint(cls.state_names()):
        return function, kinematic, fields
    return at_new_states(cls, name)


def _names_of(cls: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the fields of a class, and of those that are states, in the order of their declaration."""
    declared = declared_by(cls)
    return tuple(item.name for item in declared), tuple(item.name for item in declared if item.state)


_found: Callable[..., Found] = functools.cache(_found_of)
_names: Callable[[Any], tuple[tuple[str, ...], tuple[str, ...]]] = functools.cache(_names_of)


def _check_annotations(cls: type) -> None:
    """Refuse fields without a type, which data classes ignore."""
    annotated = inspect.get_annotations(cls)
    for name, value in vars(cls).items():
        if isinstance(value, dataclasses.Field) and name not in annotated:
            made_by = "state" if value.metadata.get("state") else "parameter"
            raise InvalidInput(f"{cls.__name__}.{name} has no type: write {name}: float = il.{made_by}(…).")


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
        if argument_name not in kinematic and argument_name not in fields and not _is_property(cls, argument_name):
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


def _is_property(cls: type[Component], name: str) -> bool:
    """Whether a name is that of a number which follows from the fields."""
    return isinstance(getattr(cls, name, None), (property, functools.cached_property))


def undefined(cls: type[Component]) -> list[str]:
    """Return the names that a class must still define, in the order of ``required``."""
    found = [(name, getattr(cls, name, None)) for name in cls.required]
    return [name for name, item in found if item is None or getattr(item, "__isabstractmethod__", False)]


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
    for declared in declared_by(cls):
        if declared.state and (declared.needed or declared.kind != "float"):
            wrong = "has no start value" if declared.needed else f"is declared as {declared.kind}"
            raise InvalidInput(
                f"The state {declared.place} {wrong}: write {declared.name}: float = il.state(0.0, units=...)."
            )
    if not updates and not undefined(cls):
        form = f"{UPDATE}({', '.join(cls.kernels[UPDATE])}, then states and other fields by name)"
        raise InvalidInput(f"{cls.__name__} has states ({some}), but no {form}, which returns their new values.")
    for potential in _POTENTIALS:
        if getattr(cls, potential, None) is not None:
            raise InvalidInput(
                f"{cls.__name__} has states ({some}), so that its force depends on the past: it has no {potential}."
            )


def _check_potentials(cls: type[Component]) -> None:
    """Refuse potentials of forces that change in time."""
    for potential, force in _POTENTIALS.items():
        if getattr(cls, potential, None) is not None and cls.has_kernel(force) and TIME in cls.arguments(force)[0]:
            raise InvalidInput(
                f"{cls.__name__}.{force} depends on time, so that it has no {potential}: write {potential} = None."
            )


def _may_end_without_value(function: types.FunctionType) -> bool:
    """Whether a function has a way to its end, or to a bare return, on which it returns None."""
    steps = [(step.opname, step.argval) for step in dis.get_instructions(function)]
    ways = [("LOAD_CONST", None), ("RETURN_VALUE", None)], [("RETURN_CONST", None)]  # by version of Python
    return any(steps[at : at + len(way)] == way for way in ways for at in range(len(steps)))


def _check_arguments(cls: type[Component], values: tuple[Any, ...], fields: dict[str, Any]) -> None:
    """Refuse unknown, surplus and missing arguments in the words of the component."""
    allowed, positional, needed = _taken_by(cls)
    for name in fields:
        if name not in allowed:
            raise InvalidInput(f"{cls.__name__} has no field {name!r}; {suggestion(name, allowed)}")
    if len(values) > len(positional):
        raise InvalidInput(
            f"{cls.__name__} takes {len(positional)} value(s) by position, not {len(values)}; "
            f"name the others: {', '.join(allowed)}."
        )
    for name in needed:
        if name not in fields and name not in positional[: len(values)]:
            raise InvalidInput(f"{cls.__name__} needs {name} ({cls.units_of(name)}).")


def _taken_of(cls: Any) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the names of all fields, of those that may be given by position, and of those that must be given."""
    declared = declared_by(cls)
    positional, needed = ([item.name for item in declared if getattr(item, flag)] for flag in ("positional", "needed"))
    return cls.field_names(), tuple(positional), tuple(needed)


_taken_by: Callable[[Any], tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = functools.cache(_taken_of)


def _validated(declared: Declared, kind: Kind, value: Any) -> Any:
    """Return the value of a field in its declared type, or refuse it."""
    if kind is NUMBER:
        value = finite(declared.place, value)
        _check_limits(declared, value)
        return value
    value = kind(declared.place, value)
    if isinstance(value, list):
        value = tuple(value)
    for item in value if isinstance(value, tuple) else (value,):
        if not isinstance(item, str | Component) and isinstance(item, NUMBERS) and not isinstance(item, bool):
            finite(declared.place, item)
            _check_limits(declared, item)
    return value


def _kinds_of(cls: Any) -> tuple[Kind, ...]:
    """Return the kinds of the values of the fields of a class; of fields that are components, the class looks."""
    homes = {name: base.__module__ for base in reversed(cls.__mro__) for name in inspect.get_annotations(base)}
    annotations = [meaning_of(homes[field.name], field.type) for field in dataclasses.fields(cls)]
    return tuple(ANYTHING if _has_parts(item) else kind_of(item) for item in annotations)


def _has_parts(annotation: Any) -> bool:
    """Whether values may be components, which files hold as data."""
    return hasattr(annotation, "to_dict") or any(map(_has_parts, typing.get_args(annotation)))


_kinds: Callable[[Any], tuple[Kind, ...]] = functools.cache(_kinds_of)


def _check_limits(declared: Declared, value: Any) -> None:
    for name, limit in declared.limits.items():
        wanted, is_beyond = _LIMITS[name]
        if is_beyond(value, limit):
            place, units = declared.place, "" if declared.units == "1" else f" {declared.units}"
            raise InvalidInput(f"{place} must be {wanted} {limit:g}{units}, not {value!r}.")
