"""Networks in which nothing is random: the exact motion from event to event, and the events located.

A network is taken apart into *lanes*, one for each realization of each network, whose numbers are arrays: a changed
parameter compiles nothing, and points of a sweep with the same numbers of bodies, contacts and waves are lanes of one
compiled call, each with its own events, shared out over the cores.

- `scenes` makes the arrays of lanes from models: masses, matrices, waves of given forces and motions, contacts.
- `modes` makes *pieces*: for a set of closed contacts, the modes of the linear motion, real or complex, with what gaps
  and forces are in them. They are made when a lane first meets the set, for all lanes at once, and kept.
- `impactlab.kernels.pieces` and `impactlab.kernels.from_event_to_event` are the compiled loop: it carries a lane from
  event to event, sums and samples on the way, and stops where it needs a piece that is not there.
- `course` calls the loop and makes pieces until all lanes are at their end.
- `families` has the numbers of networks as functions of parameters: few networks are made for many values.
- `findings` makes the same labelled datasets of it as any method gives.
- `requests` says what a request asks for, and when the method is the usual one.
- `event_located` is the integrator, and what it refuses, through the doors of `impactlab.mechanisms`.
"""
