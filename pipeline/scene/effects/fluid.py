"""Forces of a fluid on bodies as MuJoCo's ellipsoid fluid model has them, to rounding.

Each body gets a massless sphere at its centre of mass, which collides with nothing and alone is in the fluid. So the
forces do not depend on the body's shape. On a sphere of radius r at the velocity u relative to a fluid of density rho
and viscosity beta, the model has (MuJoCo's documentation, "Ellipsoid model", and engine_passive.c)

- the drag -C_blunt rho pi r^2 |u| u,
- the viscous force -6 pi r beta u and torque -8 pi r^3 beta w,
- the Magnus force C_magnus rho V w x u, V = 4/3 pi r^3, and -1/2 rho V w x u of the added mass of a sphere.

The other three coefficients (slender and angular drag, Kutta lift) are zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

DENSITY = 1e-6  # kg/m³: any but zero, since the coefficients are divided by it
#: Radius of the spheres, m. Where the fluid is viscous, the smaller it is, the smaller is the torque on the spin, which
#: no law asks for; below 3e-5 / r^2 m/s MuJoCo's drag fades (its smallest divisor is 1e-15).
RADIUS = 0.01
RADIUS_IN_VISCOUS = 1e-3  # the spin of a ball of 2 cm then decays by 1 % of what its velocity does
RADIUS_VISCOUS_ALONE = 1e-6
RADIUS_OUTSIDE = 1e-12  # of bodies without forces of the fluid, in a viscous one


@dataclass(frozen=True)
class Fluid:
    """What a fluid does to a body; numbers of several effects are added.

    Attributes:
        quadratic: kg/m, of the drag -k |u| u.
        linear: kg/s, of the drag -c u.
        lift: kg, of the force s w x u.
        velocity: (3,) m/s of the fluid.
    """

    quadratic: float = 0.0
    linear: float = 0.0
    lift: float = 0.0
    velocity: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __add__(self, other: Fluid) -> Fluid:
        velocity = tuple(a + b for a, b in zip(self.velocity, other.velocity, strict=True))
        return Fluid(self.quadratic + other.quadratic, self.linear + other.linear, self.lift + other.lift, velocity)

    @property
    def acts(self) -> bool:
        """Whether there is any force."""
        return self != Fluid(velocity=self.velocity)

    @property
    def inviscid(self) -> bool:
        """Whether there is a force beside the viscous one."""
        return self.quadratic != 0 or self.lift != 0


def expressible(bodies: Sequence[Fluid]) -> bool:
    """Whether one fluid can do this to the bodies: MuJoCo's has one velocity, and one viscosity.

    A sphere's radius sets its viscous force, so that bodies may differ in it only where they have no other force.
    """
    acting = [b for b in bodies if b.acts]
    same_air = len({b.velocity for b in acting}) <= 1
    largest = max((b.linear for b in acting), default=0.0)
    return same_air and (largest == 0 or all(b.linear == largest for b in acting if b.inviscid))


def add_fluid(root: Any, names: Sequence[str], bodies: Sequence[Fluid]) -> None:
    """Write the fluid into an MJCF document, whose bodies `names` have their centres of mass by now.

    bodies: What it does to each; `expressible`, and not nothing.
    """
    acting = [b for b in bodies if b.acts]
    largest = max(b.linear for b in acting)
    radius = RADIUS if largest == 0 else RADIUS_IN_VISCOUS
    if not any(b.inviscid for b in acting):
        radius = RADIUS_VISCOUS_ALONE
    root.option.density = DENSITY
    root.option.viscosity = largest / (6 * math.pi * radius)
    root.option.wind = acting[0].velocity
    area, volume = math.pi * radius**2, 4 / 3 * math.pi * radius**3
    for name, fluid in zip(names, bodies, strict=True):
        body = root.find("body", name)
        size = radius if fluid.inviscid or largest == 0 else max(radius * fluid.linear / largest, RADIUS_OUTSIDE)
        coefficients = np.zeros(5)  # blunt, slender and angular drag, Kutta and Magnus lift
        if fluid.inviscid:
            coefficients[0] = fluid.quadratic / (DENSITY * area)
            coefficients[4] = fluid.lift / (DENSITY * volume) + 0.5
        body.add(
            "geom",
            name=f"{name}_in_fluid",
            type="sphere",
            size=[size],
            pos=[0, 0, 0] if body.inertial is None else body.inertial.pos,
            mass=0,
            contype=0,
            conaffinity=0,
            group=3,  # not shown
            fluidshape="ellipsoid",
            fluidcoef=coefficients,
        )
