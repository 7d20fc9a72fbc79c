"""Plots of networks and results, on axes of Matplotlib: ``il.plot.density(result)``.

Every function draws into ``ax=``, or a new figure of pyplot, and returns the axes; nothing is shown or saved.

Examples
--------
>>> axes = il.plot.network(network)
"""

from impactlab.plotting.curves import peaks, spectrum
from impactlab.plotting.density_plots import density, joint_density
from impactlab.plotting.description import network_html
from impactlab.plotting.diagram_plots import basins, bifurcation, period_map
from impactlab.plotting.drawing import network
from impactlab.plotting.form_plots import correlation, cycles, extremes
from impactlab.plotting.fragility_plots import fragility, incremental
from impactlab.plotting.impact_plots import impacts
from impactlab.plotting.lines import profile, sweep
from impactlab.plotting.motion import phase_portrait, stroboscopic, trajectory
from impactlab.plotting.orbit_plots import branch
from impactlab.plotting.passage_plots import survival
from impactlab.plotting.planes import orbit
from impactlab.plotting.power_plots import observable, powers
from impactlab.plotting.section_plots import exponents, section
from impactlab.plotting.sensitivity_plots import sensitivity

__all__ = [
    "basins",
    "bifurcation",
    "branch",
    "correlation",
    "cycles",
    "density",
    "exponents",
    "extremes",
    "fragility",
    "impacts",
    "incremental",
    "joint_density",
    "network",
    "network_html",
    "observable",
    "orbit",
    "peaks",
    "period_map",
    "phase_portrait",
    "powers",
    "profile",
    "section",
    "sensitivity",
    "spectrum",
    "stroboscopic",
    "survival",
    "sweep",
    "trajectory",
]
