"""One palpation: specimen, tip, rig, sensor and log as they truly are; the defaults are a palpation without mistake."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Palpation:
    """A sine around a depth under a sphere, as declared, and how the laboratory departs from it."""

    # specimen
    elasticity: float = 112e3  # [Pa]
    viscosity: float = 362.0  # [Pa s]
    poisson: float = 0.5
    adhesion: float = 0.0  # [J/m^2], Johnson, Kendall and Roberts 1971
    fung: float | None = None  # exponent b of Lin et al. 2009
    softening_strain: float = 0.0  # c of a factor 1 - c d/R, a neo-Hookean half-space
    height: float | None = None  # [m] of a layer bonded to its base, Dimitriadis et al. 2002
    skin: tuple[float, float] | None = None  # thickness [m] and modulus over that below, Gao et al. 1992
    lump: tuple[float, float] | None = None  # contrast at 4 mm, and the length [m] that it grows by e in
    curvature: float | None = None  # [m] radius of a convex skin
    tilt: float = 0.0  # [rad] of the skin
    friction: float = 0.0  # coefficient, on a tilted skin
    branches: tuple[tuple[float, float], ...] = ()  # shares of the elastic force that relax, and their times [s]
    softening: float = 0.0  # share of the stiffness lost with the first seconds under load, time 2 s (Mullins)
    drying: float = 0.0  # share that the stiffness grows by over the sine
    swelling: float = 0.0  # [m] by which the surface rises over the sine
    creep: float = 0.0  # [m] by which the surface sinks over the sine, time 3 s
    slip: float = 0.0  # [m] by which the surface drops once, in the middle
    slide: float = 0.0  # [m] by which the surface follows the tip, with its friction: backlash of a loose specimen
    breathing: tuple[float, float] = (0.0, 0.25)  # [m] and [Hz] of the surface
    liquid: float = 0.0  # [N/m] buoyancy of a shaft in water
    drag: float = 0.0  # [N s/m] of a liquid
    meniscus: float = 0.0  # [N] by which a wet tip is pulled from touch to the way out

    # tip
    tip: str = "sphere"  # what the tip is: sphere (its paraboloid), exact-sphere, flat, cone
    radius: float = 5e-3  # [m]
    tip_mass: float = 0.14  # [kg] behind the sensor
    glove: float | None = None  # [N/m] of a soft cover, at the mean force

    # motion
    depth: float = 4e-3  # [m]
    amplitude: float = 0.8e-3  # [m]
    frequency: float = 2.0  # [Hz]
    start_depth: float = -2e-3  # [m] at the beginning; above 0 the record begins in contact
    base: float | None = None  # [N/m] of the arm, or of what the specimen stands on
    backlash: float = 0.0  # [m] between the encoder and the tip, taken up at each turn
    tremor: tuple[float, float] = (0.0, 12.0)  # [m] and [Hz], which the encoder does not see
    bump: float = 0.0  # [m] of a decaying swing of the table once, in the middle, not seen by the encoder
    thermal: float = 0.0  # [m] by which the arm grows over the sine
    wait: float = 0.0  # [s] for which the robot stands still in the middle

    # force sensor
    force_noise: float = 0.05  # [N]
    colour: float = 0.0  # correlation of the force's noise from sample to sample
    gain: float = 1.0
    curve: float = 0.0  # share of a square term at 5 N
    zero_step: float = 0.0  # [N] once, in the middle
    zero_drift: float = 0.0  # [N/s]
    warm_up: float = 0.0  # [N], time 5 s
    coupling: float | None = None  # [Hz] below which the sensor passes nothing (AC)
    low_pass: float | None = None  # [Hz] of first order
    force_mean: int = 1  # samples of a moving average that is left on
    play: float = 0.0  # [N] width of the sensor's hysteresis
    cable: float = 0.0  # [N/m] of a cable from tip to arm
    guide: float = 0.0  # [N] of Coulomb friction in a guide behind the tip
    tone: tuple[float, float, float] = (0.0, 2.0, 0.0)  # [N], [Hz], phase [rad] of a disturbance, such as an alias
    pickup: float = 0.0  # [N s/m] by which the motor's current, as the speed, reaches the sensor's cable
    ringing: tuple[float, float] | None = None  # [Hz] and damping ratio of the tool on its sensor
    force_step: float = 0.0  # [N] of the digits
    most: float | None = None  # [N] beyond which the sensor saturates
    stuck: float = 0.0  # [s] for which the force stays at one reading
    spikes: float = 0.0  # share of the readings that are off by 2 N
    zeros: float = 0.0  # share of the readings that are 0
    held: int = 1  # samples for which each reading is repeated

    # position
    position_noise: float = 5e-6  # [m]
    velocity_noise: float = 0.67e-3  # [m/s]
    height_gain: float = 1.0
    height_curve: float = 0.0  # [m] of a sine of a bad encoder disc, 1 mm long
    position_step: float = 0.0  # [m] of the digits
    commanded: float | None = None  # [s] by which a logged command is ahead of the tip, without noise
    position_mean: int = 1  # samples of a moving average of height and velocity
    velocity_mean: int = 1  # samples of a moving average of the velocity

    # log
    force_late: float = 0.0  # [s]
    position_late: float = 0.0  # [s] of height and velocity
    velocity_late: float = 0.0  # [s]
    jitter: float = 0.0  # [s] of the stamps of whole rows
    stamp_step: float = 0.0  # [s] of the stamps' digits
    clock: float = 0.0  # by which the force's clock runs fast
    rate_error: float = 0.0  # by which all stamps run fast
    gaps: int = 0  # of 30 to 100 ms
    lost: float = 0.0  # share of the rows
    doubled: float = 0.0  # share of the rows that stand twice
    force_unit: float = 1.0  # what the numbers are multiplied by
    motion_unit: float = 1.0
    velocity_unit: float = 1.0

    def truth(self) -> tuple[float, float]:
        """Elasticity [Pa] at rest and viscosity [Pa s]; of a material that never comes to rest those at the sine."""
        if len(self.branches) < 3:
            return self.elasticity, self.viscosity
        storage, loss = 1.0, 0.0
        pace = 2 * 3.141592653589793 * self.frequency
        for share, time in self.branches:
            storage += share * (pace * time) ** 2 / (1 + (pace * time) ** 2)
            loss += share * pace * time / (1 + (pace * time) ** 2)
        shear = self.elasticity / (2 * (1 + self.poisson))
        return self.elasticity * storage, self.viscosity + shear * loss / pace
