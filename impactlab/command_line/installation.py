"""Commands on the installation: what offers studies, and whether all works."""

from __future__ import annotations

import argparse

import impactlab
from impactlab.command_line.output import DONE, USAGE, Command


def add_commands(command: Command) -> None:
    """Add the commands of this family."""
    command("plugins", _plugins, "list what installed distributions offer, and what of it fails")
    command("doctor", _doctor, "check this installation")
    command("warm", _warm, "compile the usual kinds of runs into the cache, for images and clusters")


def _plugins(_: argparse.Namespace) -> int:
    from impactlab.components.offered import load_offered, offered_names
    from impactlab.studies.discovery import plugins

    found = plugins()
    for plugin in found:
        print(f"{plugin.name}  {plugin.distribution}  {plugin.problem or 'ok'}")
    code = USAGE if any(plugin.problem for plugin in found) else DONE
    for name in offered_names():
        problem = load_offered(name)
        print(f"{name}  component  {problem or 'ok'}")
        code = USAGE if problem else code
    return code


def _doctor(_: argparse.Namespace) -> int:
    """Print what this installation is, and whether a compiled network runs."""
    import os
    import time

    from impactlab.compiling.jit import cache_folder
    from impactlab.machine import cores
    from impactlab.studies.run_folder import versions

    for name, version in versions().items():
        print(f"{name:12} {version}")
    print(f"{'cores':12} {cores()}")
    folder = cache_folder()
    print(f"{'cache':12} {folder} ({'writable' if os.access(folder, os.W_OK) else 'not writable'})")
    begin = time.perf_counter()
    body = impactlab.LinearOscillator(stiffness=1.0, damping=1.0)
    network = impactlab.chain(2, body, impactlab.HertzContact(10.0), excitation=impactlab.WhiteNoise(1.0))
    impactlab.simulate(network, 30.0, realizations=64, rng=1)
    print(f"{'simulation':12} works ({time.perf_counter() - begin:.2f} s with compilation or its cache)")
    return DONE


def _warm(_: argparse.Namespace) -> int:
    """Run a small network of each usual kind, so that later processes find its machine code in the cache."""
    import time
    import warnings

    from impactlab.compiling.jit import cache_folder, compilations
    from impactlab.machine import tuned

    il = impactlab
    body = il.LinearOscillator(stiffness=1.0, damping=0.1)
    noise, wave = il.WhiteNoise(1.0), il.Harmonic(1.0, frequency=2.8)
    smooth, rigid = il.HertzContact(1e3), il.RigidContact(0.8)
    kinds = {
        "several realizations under noise": (smooth, noise, 16),
        "one realization under noise": (smooth, noise, 1),
        "rigid contacts under noise": (rigid, noise, 16),
        "rigid contacts without noise": (rigid, wave, 1),
        "smooth contacts without noise": (smooth, wave, 1),
    }
    for name, (law, excitation, realizations) in kinds.items():
        network = il.Network({"a": body}, {"stop": il.Contact("a", il.WALL, law, clearance=0.1)}, {"a": excitation})
        begin, before = time.perf_counter(), compilations()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", il.AccuracyWarning)  # of runs this short
            with tuned(single_lane_steps=0.0):  # one realization as in long runs
                il.simulate(network, 5.0, realizations=realizations, rng=1, spin_up=0.0, initial="rest", progress=False)
        print(f"{name:34} {compilations() - before:3} compiled  {time.perf_counter() - begin:6.1f} s", flush=True)
    print(f"in {cache_folder()}")
    return DONE
