"""Write the page of all that networks are made of, docs/catalogue.md, and draw what each part does.

Run ``python docs/figures/catalogue.py [FOLDER]``; the default is this folder. It takes seconds.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import impactlab as il
from impactlab.components.evaluation import ELAPSED, UPDATE
from impactlab.plotting.style import COLORS, style

INTRODUCTION = """# Catalogue

All bodies, contacts, couplings, laws and excitations, as `il.catalogue()` returns them; names in lower case are
functions. δ is an indentation, e an extension, x a displacement; a prime is a derivative with respect to time.
Parameters have their units and defaults; the docstrings have the details. To write your own law, see [laws of your
own](how_to/laws.md).
"""

POINTS, TURNS = 2000, 2.25

EXAMPLES: dict[str, dict[str, Any]] = {
    "contact laws": {
        "AdhesiveContact": il.AdhesiveContact(1.0, pull_off=0.2),
        "CarvalhoMartinsContact": il.CarvalhoMartinsContact(1.0, restitution=0.6),
        "FloresContact": il.FloresContact(1.0, restitution=0.6),
        "GonthierContact": il.GonthierContact(1.0, restitution=0.6),
        "HertzContact": il.HertzContact(1.0),
        "HertzdampContact": il.HertzdampContact(1.0, restitution=0.6),
        "HuntCrossleyContact": il.HuntCrossleyContact(1.0, dissipation=0.5),
        "JankowskiContact": il.JankowskiContact(1.0, damping=0.4),
        "KelvinVoigtContact": il.KelvinVoigtContact(1.0, damping=0.3),
        "LankaraniNikraveshContact": il.LankaraniNikraveshContact(1.0, restitution=0.6),
        "LinearContact": il.LinearContact(1.0),
        "PowerLawContact": il.PowerLawContact(1.0, exponent=3.0),
        "ThorntonContact": il.ThorntonContact(1.0, yield_indentation=0.3),
        "TsujiContact": il.TsujiContact(1.0, damping=0.4),
        "WaltonBraunContact": il.WaltonBraunContact(loading=1.0, unloading=2.0),
    },
    "coupling laws": {
        "BilinearCoupling": il.BilinearCoupling(1.0, outer_stiffness=3.0, break_extension=0.5),
        "BoucWenCoupling": il.BoucWenCoupling(1.0, yield_displacement=0.3, ratio=0.1),
        "CoulombFrictionCoupling": il.CoulombFrictionCoupling(1.0),
        "CubicCoupling": il.CubicCoupling(1.0),
        "FrictionCoupling": il.FrictionCoupling(1.0, velocity=0.1),
        "JenkinsCoupling": il.JenkinsCoupling(2.0, slip_force=1.0),
        "LinearCoupling": il.LinearCoupling(1.0, damping=0.3),
        "MaxwellCoupling": il.MaxwellCoupling(1.0, damping=1.0),
        "PiezoelectricCoupling": il.PiezoelectricCoupling(1.0, capacitance=1.0, resistance=1.0),
        "PowerLawCoupling": il.PowerLawCoupling(1.0, exponent=0.5),
        "PowerLawDampingCoupling": il.PowerLawDampingCoupling(1.0, exponent=0.5),
        "QuadraticDampingCoupling": il.QuadraticDampingCoupling(1.0),
        "ZenerCoupling": il.ZenerCoupling(1.0, relaxing_stiffness=1.0, damping=1.0),
    },
    "contacts and couplings": {
        "Contact": [il.Contact("a", il.WALL, il.HertzContact(1.0), clearance=0.3)],
        "RoundContact": [il.RoundContact(("a", "b"), il.WALL, il.HertzContact(1.0), clearance=0.5)],
        "Coupling": [il.Coupling("a", il.WALL, il.LinearCoupling(1.0))],
        "backlash": [*il.backlash("a", il.WALL, il.HertzContact(1.0), clearance=0.3, name="gap").values()],
    },
    "bodies": {
        "DoubleWellOscillator": il.DoubleWellOscillator(cubic=2.0, repulsion=1.0),
        "DuffingOscillator": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=2.0),
        "InvertedOscillator": il.InvertedOscillator(repulsion=1.0),
        "LinearOscillator": il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0),
        "ParametricOscillator": il.ParametricOscillator(0.5, stiffness=1.0, frequency=2.0),
        "RayleighOscillator": il.RayleighOscillator(stiffness=1.0, growth=0.5, speed=0.6),
        "VanDerPolOscillator": il.VanDerPolOscillator(stiffness=1.0, growth=0.5, width=0.6),
    },
    "excitations": {
        "Chirp": il.Chirp(1.0, start_frequency=2.0, end_frequency=12.0, duration=8.0),
        "ConstantForce": il.ConstantForce(1.0),
        "Harmonic": il.Harmonic(1.0, frequency=2.0),
        "ModulatedForce": il.ModulatedForce(
            il.Harmonic(1.0, frequency=5.0), (0.0, 3.0, 6.0, 9.0), (0.0, 1.0, 1.0, 0.0)
        ),
        "Pulse": il.Pulse(1.0, duration=2.0, start=2.0),
        "SampledForce": il.SampledForce((0.0, 2.0, 3.0, 6.0, 10.0), (0.0, 1.0, -0.6, 0.3, 0.0)),
    },
}
"""Components of each family whose force is a function of motion or time, with values that show what it does."""

AXES = {
    "bodies": ("displacement (m)", "force (N)"),
    "contact laws": ("indentation (m)", "force (N)"),
    "contacts and couplings": ("displacement (m)", "force (N)"),
    "coupling laws": ("extension (m)", "force (N)"),
    "excitations": ("time (s)", "force (N)"),
}

CAPTIONS = {
    "bodies": "Force of spring, damper and residual force, beside the displacement, of x = cos t.",
    "contact laws": "Force beside the indentation, of δ = sin t.",
    "contacts and couplings": "Force on a body beside its displacement x; in the round clearance at y = 0.3 m along x.",
    "coupling laws": "Force beside the extension, of e = sin t from rest.",
    "excitations": "Force over time.",
}


def followed(law: Any, kernel: str, place: np.ndarray, rate: np.ndarray, interval: float) -> np.ndarray:
    """Return the forces of a law along a motion, on whose way its states change."""
    forces = np.empty_like(place)
    states = law.state_names()
    for number, motion in enumerate(zip(place.tolist(), rate.tolist(), strict=True)):
        forces[number] = law.call(kernel, *motion, 0.0)
        if states:
            kinematic, fields = law.arguments(UPDATE)
            known = {**dict(zip(law.kernels[UPDATE], motion, strict=False)), ELAPSED: interval, "time": 0.0}
            arguments = [known[name] for name in kinematic] + [getattr(law, name) for name in fields]
            new = law.update(*arguments)
            law = law.replace(**dict(zip(states, (new,) if len(states) == 1 else new, strict=True)))
    return forces


def pushed(link: Any, x: np.ndarray) -> np.ndarray:
    """Return the force on a body at its displacements from a contact or a coupling with a wall."""
    if isinstance(link, il.RoundContact):
        radius = np.hypot(x, 0.3)
        return -link.law.evaluate(radius - link.clearance) * x / radius
    sign = 1.0 if link.second is il.WALL else -1.0
    if isinstance(link, il.Coupling):
        return sign * link.law.evaluate(-sign * x)
    return -sign * link.law.evaluate(sign * x - link.clearance)


def curve(family: str, component: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return what is drawn of a component."""
    if family == "excitations":
        time = np.linspace(0.0, 10.0, POINTS)
        return time, np.broadcast_to(component.call("force", time), time.shape)
    if family == "contacts and couplings":
        x = np.linspace(-1.0, 1.0, POINTS)
        return x, sum(pushed(link, x) for link in component)
    if family == "bodies":
        time = np.linspace(0.0, 2.0 * np.pi, POINTS)
        x, v = np.cos(time), -np.sin(time)
        own = component.stiffness * x + component.damping * v
        return x, own + (0.0 if isinstance(component, il.LinearOscillator) else component.call("residual", x, v, 0.0))
    end = np.pi if family == "contact laws" else TURNS * np.pi
    time = np.linspace(1e-9, end, POINTS)
    return np.sin(time), followed(component, "force", np.sin(time), np.cos(time), time[1] - time[0])


def draw(family: str) -> Figure:
    """Draw all components of a family, one beside the other."""
    examples = EXAMPLES[family]
    rows = -(-len(examples) // 4)
    figure = Figure(figsize=(9.0, 0.3 + 1.9 * rows), layout="constrained")
    axes = figure.subplots(rows, 4, squeeze=False).ravel()
    for ax, (name, component) in zip(axes, examples.items(), strict=False):
        ax.plot(*curve(family, component), color=COLORS[0], lw=1.2)
        ax.axhline(0.0, color="0.7", lw=0.6, zorder=0)
        ax.set_title(name, fontsize=7)
        ax.tick_params(labelsize=6)
    for ax in axes[len(examples) :]:
        ax.set_axis_off()
    below, beside = AXES[family]
    figure.supxlabel(below, fontsize=8)
    figure.supylabel(beside, fontsize=8)
    return figure


def page() -> str:
    """Return the text of the page."""
    lines = INTRODUCTION.splitlines()
    for family in EXAMPLES:
        lines += [
            "",
            f"## {family.capitalize()}",
            "",
            "| name | description | parameters | source |",
            "|---|---|---|---|",
        ]
        for entry in il.catalogue(family):
            cells = [f"`il.{entry.name}`", entry.description, ", ".join(entry.parameters), entry.source]
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        lines += ["", f"![{CAPTIONS[family]}](figures/catalogue_{family.replace(' ', '_')}.png)", "", CAPTIONS[family]]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    with style():
        for family in EXAMPLES:
            draw(family).savefig(folder / f"catalogue_{family.replace(' ', '_')}.png", dpi=80)
    (folder.parent / "catalogue.md").write_text(page(), encoding="utf-8")
