"""The flags of a calibration in use."""

from palpate import FlagMeaning


def _doubtful(meaning: str, remedy: str) -> FlagMeaning:
    return FlagMeaning("doubtful", meaning, remedy)


CALIBRATION_FLAGS = {
    "calibration-old": _doubtful("The calibration is older than allowed, or from the future.", "Calibrate again."),
    "calibration-sensor": _doubtful("The calibration was made with another sensor or arm.", "Calibrate this one."),
    "calibration-tip": _doubtful("The calibration was made with another tip.", "Calibrate with this tip."),
    "calibration-offset": _doubtful(
        "The sensor was restarted after its offset was calibrated: the offset has moved.",
        "Calibrate again, or let the standstill or the free air give the tare.",
    ),
    "calibration-offset-unknown": FlagMeaning(
        "note",
        "It is not known whether the sensor was restarted after its offset was calibrated.",
        "State [device.*] supply, or let the standstill or the free air give the tare.",
    ),
    "calibration-mass": _doubtful(
        "The tip's mass in the file contradicts the calibration.", "Correct one of them, or leave tip_mass out."
    ),
    "calibration-delay": _doubtful(
        "The delay in the file contradicts the calibration.", "Correct one of them, or leave the delay out."
    ),
}
