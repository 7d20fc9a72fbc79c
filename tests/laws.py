"""Laws of a user's own that several tests use, beside those of `impactlab_numerics.laws`."""

import math

import impactlab as il


class RunawayContact(il.ContactLaw):
    """Pulls instead of pushing, ever harder."""

    @staticmethod
    def force(indentation):
        return -1e6 * indentation


class SofteningContact(il.ContactLaw):
    """A force with a kink where no contact opens or closes."""

    stiffness: float = il.parameter(units="N m-1")
    depth: float = il.parameter(units="m")
    softening: float = il.parameter(0.1)

    @staticmethod
    def force(indentation, stiffness, depth, softening):
        return stiffness * (min(indentation, depth) + softening * max(indentation - depth, 0.0))

    @staticmethod
    def potential(indentation, stiffness, depth, softening):
        first, rest = min(indentation, depth), max(indentation - depth, 0.0)
        return stiffness * (0.5 * first**2 + depth * rest + 0.5 * softening * rest**2)


class TabulatedContact(il.ContactLaw):
    """A force given at equally distant indentations, linear between and beyond them."""

    forces: tuple[float, ...] = il.parameter(units="N")
    distance: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(indentation, forces, distance):
        last = min(int(indentation / distance), len(forces) - 2)
        return forces[last] + (indentation / distance - last) * (forces[last + 1] - forces[last])


class LossyContact(il.ContactLaw):
    """A spring with a damper that grows with the indentation."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    damping: float = il.parameter(units="N s m-2", minimum=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, damping):
        return stiffness * indentation + damping * indentation * rate


class DampedCubicCoupling(il.CouplingLaw):
    """Reads the rate as well, and kicks."""

    cubic: float = il.parameter(units="N m-3", minimum=0.0)
    damping: float = il.parameter(units="N s m-1", minimum=0.0)

    @staticmethod
    def force(extension, rate, cubic, damping):
        return cubic * extension**3 + damping * rate


class DoubleWell(il.Oscillator):
    """Two wells at ±1 m, tilted by a constant force."""

    depth: float = il.parameter(units="J", above=0.0)
    tilt: float = il.parameter(0.0, units="N")

    @staticmethod
    def residual(displacement, depth, tilt):
        return 4.0 * depth * displacement * (displacement**2 - 1.0) + tilt

    @staticmethod
    def residual_potential(displacement, depth, tilt):
        return depth * (displacement**2 - 1.0) ** 2 - depth + tilt * displacement


class TwoWells(il.Oscillator):
    """A body with two wells, in which its spring alone would not hold it."""

    well: float = il.parameter(units="N m-1")
    wall: float = il.parameter(units="N m-3")

    @staticmethod
    def residual(displacement, well, wall):
        return -well * displacement + wall * displacement**3

    @staticmethod
    def residual_potential(displacement, well, wall):
        return -0.5 * well * displacement**2 + 0.25 * wall * displacement**4


class Cosine(il.Excitation):
    """Given force ``amplitude cos(frequency t)``."""

    amplitude: float = il.parameter(units="N")
    frequency: float = il.parameter(units="rad s-1")

    @staticmethod
    def force(time, amplitude, frequency):
        return amplitude * math.cos(frequency * time)


class TwoLines(il.Excitation):
    """Two cosines with random phases, of 2 N and 5 N."""

    first: float = il.parameter(units="rad s-1")
    second: float = il.parameter(units="rad s-1")

    def lines(self):
        return [self.first, self.second], [2.0, 5.0]


class Interval(il.Excitation):
    """White noise in an interval of time, and hardly any before and after."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    begin: float = il.parameter(units="s")
    end: float = il.parameter(units="s")

    @staticmethod
    def intensity(time, level, begin, end):
        return level if begin < time < end else 1e-6 * level


class Slider(il.Oscillator):
    """Body on a spring that slips at some force (Jenkins)."""

    spring: float = il.parameter(units="N m-1")
    most: float = il.parameter(units="N")
    slip: float = il.state(0.0, units="m")

    def residual(displacement, spring, slip):
        return spring * (displacement - slip)

    def update(displacement, slip, spring, most):
        play = most / spring
        return min(max(slip, displacement - play), displacement + play)


class WorkingContact(il.ContactLaw):
    """Kelvin and Voigt's, with the work of its force by the rule that anybody would write."""

    stiffness: float = il.parameter(units="N m-1")
    damping: float = il.parameter(units="N s m-1")
    work: float = il.state(0.0, units="J")

    def force(indentation, rate, stiffness, damping):
        return max(stiffness * indentation + damping * rate, 0.0)

    def update(indentation, rate, elapsed, work, stiffness, damping):
        force = max(stiffness * indentation + damping * rate, 0.0) if indentation > 0.0 else 0.0
        return work + force * rate * elapsed


class WorkingImpacts(il.LankaraniNikraveshContact):
    """Impacts by their restitution, with the work of their force."""

    work: float = il.state(0.0, units="J")

    def update(indentation, rate, elapsed, closing, work, stiffness, exponent, loss):
        first = closing if closing > 0.0 else max(rate, 0.0)
        first = first if indentation > 0.0 else 0.0
        damping = loss * min(max(rate / first, -1.0), 1.0) if first > 0.0 else 0.0
        force = stiffness * indentation**exponent * max(1.0 + damping, 0.0) if indentation > 0.0 else 0.0
        return first, work + force * rate * elapsed
