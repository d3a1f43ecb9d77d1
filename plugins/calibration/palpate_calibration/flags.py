"""The flags of a calibration in use."""

from palpate import FlagMeaning


def _doubtful(meaning: str, remedy: str) -> FlagMeaning:
    return FlagMeaning("doubtful", meaning, remedy)


CALIBRATION_FLAGS = {
    "calibration-old": _doubtful("The calibration is older than allowed, or from the future.", "Calibrate again."),
    "calibration-other": _doubtful(
        "The calibration was made with another sensor, arm or tip.", "Calibrate what is on the robot now."
    ),
    "calibration-sensor": FlagMeaning.sign("calibration-other", "The calibration was made with another sensor or arm."),
    "calibration-tip": FlagMeaning.sign("calibration-other", "The calibration was made with another tip."),
    "calibration-offset": _doubtful(
        "The sensor was restarted after its offset was calibrated: the offset has moved.",
        "Calibrate again, or let the standstill or the free air give the tare.",
    ),
    "calibration-offset-unknown": FlagMeaning(
        "note",
        "It is not known whether the sensor was restarted after its offset was calibrated.",
        "State [device.*] supply, or let the standstill or the free air give the tare.",
    ),
    "calibration-contradicted": _doubtful(
        "The tip's mass or a delay in the file contradicts the calibration.",
        "Correct one of them, or leave tip_mass or the delay out of the file.",
    ),
    "calibration-mass": FlagMeaning.sign(
        "calibration-contradicted", "The tip's mass in the file contradicts the calibration."
    ),
    "calibration-delay": FlagMeaning.sign(
        "calibration-contradicted", "The delay in the file contradicts the calibration."
    ),
}
