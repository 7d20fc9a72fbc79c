"""The arrays of networks in which nothing is random: linear bodies, waves that drive them, and contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.excitation import Excitation
from impactlab.components.loads import ConstantForce, Harmonic
from impactlab.kernels.contact_states import DASHPOT, FRICTION, JENKINS, RIGID, SPRING
from impactlab.located.rows_of_couplings import Rows, inner_springs, rows_of_couplings, weights

TOUCHING = 1e-12
"""Part of the sizes of displacements by which bodies may overlap where a run begins."""

ROUNDS = 50
"""Sets of closed contacts that are tried."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Networks as lanes: ``M x'' + C x' + K x = p + Re Σ f exp(i ω t) + L q(t)``, gaps ``W x + g + Re Σ u exp(i ω t)``.

    Bodies of given motion are no part of x; they drive the others, and move gaps. Places of sliders come last in x.
    """

    mass: np.ndarray  # (lane, body)
    damping: np.ndarray  # (lane, body, body)
    stiffness: np.ndarray
    frequencies: np.ndarray  # (lane, wave), 0 for waves that a lane does not have
    load: np.ndarray  # (lane, body)
    force: np.ndarray  # (lane, body, wave), complex
    points: np.ndarray  # (lane, point, body) weights of the bodies in each point of a structure
    links: np.ndarray  # (lane, contact, body)
    gap: np.ndarray  # (lane, contact)
    wall: np.ndarray  # (lane, contact, wave), complex
    springs: np.ndarray  # (lane, contact) stiffness of each contact
    dampers: np.ndarray
    restitution: np.ndarray
    frictions: np.ndarray  # (lane, contact, 3) of dry friction: sliding, breakaway, velocity of the surface
    loads: np.ndarray  # (lane, body, source) weights of given functions
    functions: tuple[tuple[Excitation, ...], ...]  # of each lane
    kinds: np.ndarray  # (contact,) SPRING, DASHPOT, RIGID or FRICTION; the same in all lanes
    flows: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))
    """(flow, 4) products that are integrated, see `impactlab.kernels.integrals`; the same in all lanes."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of bodies, contacts and waves."""
        return self.mass.shape[1], self.gap.shape[1], self.frequencies.shape[1]

    @property
    def fastest(self) -> float:
        """Largest natural frequency of a body alone (rad s-1)."""
        return float(np.sqrt(np.diagonal(self.stiffness, axis1=1, axis2=2) / self.mass).max(initial=0.0))

    def at_rest(self) -> np.ndarray:
        """Return displacements under the static forces of contacts alone, 0 where none is closed there, (1, body).

        Rigid contacts that would overlap touch.
        """
        pressed, bodies = self.kinds < FRICTION, self.mass.shape[1]
        gap, links, springs = self.gap[0, pressed], self.links[0, pressed], self.springs[0, pressed]
        rigid, x, closed = self.kinds[pressed] == RIGID, np.zeros(bodies), gap > 0.0
        for _ in range(ROUNDS if closed.any() else 0):
            k, held = springs * (closed & ~rigid), closed & rigid
            hard, forces = links[held], np.zeros(len(gap))
            matrix = np.block([[self.stiffness[0] + (links.T * k) @ links, hard.T], [hard, np.zeros((len(hard),) * 2)]])
            known = np.concatenate([-links.T @ (k * gap), -gap[held]])
            found = np.linalg.lstsq(matrix, known, rcond=None)[0]
            x, forces[held] = found[:bodies], found[bodies:]
            after = np.where(held, forces > 0.0, links @ x + gap > 0.0)
            if (after == closed).all():
                break
            closed = after
        return x[None]

    @property
    def alike(self) -> tuple[Any, ...]:
        """What the scenes of one call have in common."""
        return *self.shape, self.points.shape[1], self.loads.shape[2], self.kinds.tobytes(), self.flows.tobytes()

    def lanes(self, chosen: np.ndarray) -> Linear:
        """Return some lanes, which may be chosen several times."""
        parts = {name: getattr(self, name)[chosen] for name in ARRAYS}
        given = self.loads.shape[2] > 0
        functions = tuple(self.functions[lane] for lane in chosen.tolist()) if given else ((),) * len(chosen)
        return Linear(**parts, functions=functions, kinds=self.kinds, flows=self.flows)


ARRAYS = tuple(name for name in Linear.__dataclass_fields__ if name not in ("functions", "kinds", "flows"))
"""Fields of scenes that have a row for each lane."""


def as_lanes(scenes: Sequence[Linear]) -> Linear:
    """Return networks of one shape as the lanes of one scene."""
    parts = {name: np.concatenate([getattr(scene, name) for scene in scenes]) for name in ARRAYS}
    functions = tuple(lane for scene in scenes for lane in scene.functions)
    return Linear(**parts, functions=functions, kinds=scenes[0].kinds, flows=scenes[0].flows)


def linear_of(model: Model) -> Linear:
    """Return a network, all parts of which are known to be linear, as one lane."""
    given = ~model.bodies.free
    free = np.flatnonzero(~given)
    strengths = model.couplings.linear[0] + inner_springs(model), model.couplings.linear[1]
    springs, dampers = (model.coupled.springs(strength) for strength in strengths)
    stiffness, damping = np.diag(model.stiffness) + springs, np.diag(model.damping) + dampers
    waves = _Waves(model)
    rows = rows_of_couplings(model)
    links = np.concatenate([weights(model.ends), rows.links])
    # bodies of given motion: their constant part, and their waves
    place, motion = waves.constants[given], waves.waves[given]
    between = np.ix_(free, np.flatnonzero(given))
    driven = stiffness[between][:, :, None] + 1j * waves.frequencies * damping[between][:, :, None]
    load = waves.constants[free] - stiffness[between] @ place
    force = waves.waves[free] - np.einsum("ijw,jw->iw", driven, motion)
    laws = model.contacts.laws
    one = np.ix_(free, free)
    numbers = [law.linear or (0.0, 0.0) for law in laws] + [(spring, 0.0) for spring in rows.springs]
    springs, dampers = np.array(numbers).reshape(-1, 2).T
    clearance = np.concatenate([model.clearance, rows.clearance])
    contacts = [_kind(model, contact) for contact in range(len(laws))]
    return _with_sliders(
        rows,
        Linear(
            mass=model.mass[None, free],
            damping=damping[one][None],
            stiffness=stiffness[one][None],
            frequencies=waves.frequencies[None],
            load=load[None],
            force=force[None],
            points=points_of(model)[None][:, :, free],
            links=links[None][:, :, free],
            gap=(links[:, given] @ place - clearance)[None],
            wall=(links[:, given] @ motion)[None],
            springs=springs[None],
            dampers=dampers[None],
            restitution=np.array([[*(getattr(law, "restitution", 0.0) for law in laws), *np.zeros(len(rows.kinds))]]),
            frictions=np.concatenate([np.zeros((len(laws), 3)), rows.frictions])[None],
            loads=waves.loads[None, free],
            functions=(tuple(waves.functions),),
            kinds=np.array([*contacts, *rows.kinds], dtype=np.int64),
        ),
    )


def _with_sliders(rows: Rows, scene: Linear) -> Linear:
    """Return a network with coordinates of sliders behind those of bodies."""
    more = 0, int((rows.kinds == JENKINS).sum())
    if not more[1]:
        return scene
    last = dict.fromkeys(("points", "links"), ((0, 0), (0, 0), more))
    first = dict.fromkeys(("mass", "load"), ((0, 0), more)) | dict.fromkeys(("force", "loads"), ((0, 0), more, (0, 0)))
    both = dict.fromkeys(("damping", "stiffness"), ((0, 0), more, more))
    changed: dict[str, Any] = {
        name: np.pad(getattr(scene, name), widths) for name, widths in (first | last | both).items()
    }
    changed["mass"][:, scene.mass.shape[1] :] = 1.0  # of no effect: they are held, or go with others
    return replace(scene, **changed)


def _kind(model: Model, contact: int) -> int:
    law = model.contacts.laws[contact]
    if model.contacts.impulsive[contact]:
        return RIGID
    assert law.linear is not None
    return DASHPOT if law.linear[1] and not getattr(law, "tension", False) else SPRING


def points_of(model: Model) -> np.ndarray:
    """Return the weight of each body in each point of a structure, (point, body)."""
    result = np.zeros((len(model.points), len(model.bodies)))
    for row, (_, shares) in enumerate(model.points):
        for slot, share in shares:
            result[row, slot] = share
    return result


class _Waves:
    """Given forces, and displacements of bodies of given motion: constants, waves of a few frequencies, and others."""

    def __init__(self, model: Model) -> None:
        sources, bodies = model.sources["force"], len(model.bodies)
        found: dict[float, np.ndarray] = {}
        self.constants, self.functions, loads = np.zeros(bodies), list[Excitation](), [np.zeros((0, bodies))]
        for number, excitation in enumerate(sources.excitations):
            slots, weights = sources.driven(number)
            if not isinstance(excitation, ConstantForce | Harmonic):
                self.functions.append(excitation)
                loads.append(np.zeros((1, bodies)))
                np.add.at(loads[-1][0], slots, weights)
                continue
            constant, frequency, amplitude = wave_of(excitation)
            np.add.at(self.constants, slots, weights * constant)
            if amplitude:
                np.add.at(found.setdefault(frequency, np.zeros(bodies, complex)), slots, weights * amplitude)
        self.frequencies = np.array(sorted(found))
        self.waves = np.array([found[item] for item in self.frequencies]).reshape(-1, bodies).T
        self.loads = np.concatenate(loads).T


def wave_of(excitation: Excitation) -> tuple[float, float, complex]:
    """Return the constant part of a given function, and the frequency and complex amplitude of its wave."""
    if isinstance(excitation, ConstantForce):
        return excitation.load, 0.0, 0j
    assert isinstance(excitation, Harmonic)
    turned = complex(math.sin(excitation.phase), -math.cos(excitation.phase))
    return 0.0, excitation.frequency, excitation.amplitude * turned
