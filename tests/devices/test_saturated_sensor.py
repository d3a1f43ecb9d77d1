"""A sensor that saturates with noise on top, and sound rigs beside it: judged by what the twin's arm did."""

import numpy as np
import pytest
from palpate import PalpateError

from tests.devices.simulated_bench import PIPELINE
from tests.devices.test_late_readings import STIFF, stiff  # noqa: F401  (a fixture)

MOTIONS = {
    "point": 'type = "point"\nbias = "{depth} mm"\namplitude = "{swing} mm"\nfrequency = "{frequency} Hz"\n'
    'duration = "1 s"\n',
    "ramp-hold": 'type = "ramp-hold"\ndepths = ["{swing} mm", "{depth} mm"]\nhold = "0.4 s"\n'
    'speed = "{speed} mm/s"\nturn = "0.02 s"\n',
    "load-unload": 'type = "load-unload"\ndepth = "{depth} mm"\nspeeds = ["{speed} mm/s"]\nturn = "0.02 s"\n',
    "force-hold": 'type = "force-hold"\nforce = "{force} N"\ndepth = "{depth} mm"\nduration = "4 s"\n'
    'stiffness = "{stiffness} N/mm"\n',
}


@pytest.mark.slow
@pytest.mark.parametrize(("level", "noise"), [(8.0, 0.05), (4.0, 0.02), (11.0, 0.005)])
def test_the_arm_stops_within_the_force(stiff, level, noise):  # noqa: F811
    """Before, the motion went on to its end: 103 N, told 9."""
    rig = stiff()
    error, _, _ = rig.run_into(f"saturated-force {level} {noise}", lambda state: state["height"] < 1e-3)
    assert "sensor.wrench.z rises by" in error
    assert "the sensor is saturated" in error
    assert level - 1.0 < rig.truth.force < level + 4.0
    assert rig.wait_at_rest()["height"] > 2e-3  # it has left the material


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_a_sound_rig_is_not_stopped_for_it(simulated, tmp_path, seed):
    """Each motion three times: what the detector's 1000 rigs leave out is the arm, its controller and its clocks."""
    rng = np.random.default_rng(seed)
    kind = list(MOTIONS)[seed % len(MOTIONS)]
    softest = 50e3 if kind == "force-hold" else 1e3  # a force that is held is more than noise
    stiffest = 5e6 if kind == "load-unload" else 400e3  # the rule of overshoot refuses what more would have to state
    elasticity = float(np.exp(rng.uniform(np.log(softest), np.log(stiffest))))
    most = min((5.0 / (16 / 9 * elasticity * 0.005**0.5)) ** (2 / 3), 4e-3)  # [m] at 5 N
    depth = 1e3 * most * float(rng.uniform(0.4, 1.0))
    force = 16 / 9 * elasticity * 0.005**0.5 * (1e-3 * depth) ** 1.5
    numbers = {
        "depth": depth,
        "force": 0.4 * force,
        "swing": 0.3 * depth,
        "frequency": float(rng.choice([0.5, 1.0, 2.0])),
    }
    numbers |= {"speed": float(rng.uniform(1.0, 4.0)), "stiffness": 1.5 * force / depth}
    numbers = {name: f"{value:.4f}" for name, value in numbers.items()}
    text = PIPELINE.read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    file = tmp_path / "sound.toml"
    motion = MOTIONS[kind].format(**numbers)
    file.write_text(f'{text[:begin]}[trajectory.press]\n{motion}clearance = "3 mm"\nstandstill = "0 s"\n\n{text[end:]}')
    sets = [entry for entry in STIFF if "specimen" not in entry and "stiffness" not in entry]
    stiffness = min(max(float(numbers["stiffness"]), 0.5), 20.0 if kind == "load-unload" else 4.0)
    rig = simulated(
        *sets,
        f"safety.stiffness={stiffness} N/mm",
        "safety.acceleration=0.6 m/s^2",
        f"twin.bench.specimen.elasticity={elasticity}",
        f"twin.bench.specimen.viscosity={elasticity * float(rng.uniform(0.0, 5e-3))}",
        "twin.bench.specimen.surface=0 mm",
        f"twin.bench.force_std={float(rng.uniform(0.005, 0.05))}",
        pipeline=file,
    )
    try:
        rig.run()
        ended = "done"
    except PalpateError as error:
        ended = str(error)
    assert "saturated" not in ended
    assert ended == "done", ended
