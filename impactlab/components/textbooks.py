"""Where formulas are found that belong to no paper: sources of the catalogue for what networks need not cite."""

from __future__ import annotations

from impactlab.components.literature import article, entry

_VIBRATIONS = entry("book", "Rao, S. S.", 2011, title="Mechanical Vibrations")
_STRUCTURES = entry("book", "Chopra, A. K.", 1995, title="Dynamics of Structures")
_COORDINATES = entry("book", "Craig, R. R. and Kurdila, A. J.", 2006, title="Fundamentals of Structural Dynamics")
_CONTACTS = entry("book", "Johnson, K. L.", 1985, title="Contact Mechanics")
_RANDOM = entry("book", "Lutes, L. D. and Sarkani, S.", 2004, title="Random Vibrations")
_COSINES = article(
    "Shinozuka, M. and Jan, C.-M.", "Digital simulation of random processes and its applications", "J. Sound Vib.",
    25, 1972, "111",
)  # fmt: skip

SOURCES: dict[str, str] = {
    "BandPassNoise": _RANDOM,
    "BaseMotion": _STRUCTURES,
    "Chirp": article(
        "Gloth, G. and Sinapius, M.", "Analysis of swept-sine runs during modal identification",
        "Mech. Syst. Signal Process.", 18, 2004, "1421",
    ),
    "Combination": _COORDINATES,
    "ConstantForce": _VIBRATIONS,
    "Contact": _CONTACTS,
    "Coupling": _VIBRATIONS,
    "DuffingOscillator": entry(
        "book", "Duffing, G.", 1918, title="Erzwungene Schwingungen bei veränderlicher Eigenfrequenz"
    ),
    "Harmonic": _VIBRATIONS,
    "LinearContact": article(
        "Shaw, S. W. and Holmes, P. J.", "A periodically forced piecewise linear oscillator", "J. Sound Vib.",
        90, 1983, "129",
    ),
    "LinearCoupling": _VIBRATIONS,
    "LinearOscillator": _VIBRATIONS,
    "LinearOscillator.massless": entry(
        "book", "Karnopp, D. C. and Margolis, D. L. and Rosenberg, R. C.", 2012, title="System Dynamics"
    ),
    "LinearStructure": _STRUCTURES,
    "ModalStructure": _STRUCTURES,
    "ModulatedForce": _VIBRATIONS,
    "PowerLawContact": _CONTACTS,
    "PowerLawCoupling": entry(
        "book", "Vakakis, A. F. and Gendelman, O. V. and Bergman, L. A. and McFarland, D. M. and others", 2008,
        title="Nonlinear Targeted Energy Transfer in Mechanical and Structural Systems",
    ),
    "PrescribedMotion": article(
        "Holmes, P. J.", "The dynamics of repeated impacts with a sinusoidally vibrating table", "J. Sound Vib.",
        84, 1982, "173",
    ),
    "Pulse": _STRUCTURES,
    "RigidContact": entry("book", "Brogliato, B.", 2016, title="Nonsmooth Mechanics"),
    "RoundContact": entry("book", "Muszynska, A.", 2005, title="Rotordynamics"),
    "SampledForce": _STRUCTURES,
    "Source": _RANDOM,
    "TabulatedNoise": _COSINES,
    "WhiteNoise": _RANDOM,
    "backlash": article(
        "Kahraman, A. and Singh, R.", "Non-linear dynamics of a spur gear pair", "J. Sound Vib.", 142, 1990, "49"
    ),
    "beam": entry("book", "Rao, S. S.", 2007, title="Vibration of Continuous Systems"),
    "coherent": article(
        "Deodatis, G.", "Simulation of ergodic multivariate stochastic processes", "J. Eng. Mech.", 122, 1996, "778"
    ),
    "correlated": _RANDOM,
    "davenport": article(
        "Davenport, A. G.", "The spectrum of horizontal gustiness near the ground in high winds",
        "Q. J. R. Meteorol. Soc.", 87, 1961, "194",
    ),
    "harichandran_vanmarcke": article(
        "Harichandran, R. S. and Vanmarcke, E. H.",
        "Stochastic variation of earthquake ground motion in space and time",
        "J. Eng. Mech.", 112, 1986, "154",
    ),
}  # fmt: skip
"""Entries of BibTeX by the public name."""
