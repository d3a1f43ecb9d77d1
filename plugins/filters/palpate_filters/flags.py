"""The flags of filters."""

from palpate import FlagMeaning

FILTER_FLAGS = {
    "noise-bias": FlagMeaning(
        "doubtful",
        "The noise in this filter's own state biases its estimates.",
        "Give the corrected value where there is one, or use a fit (inertial filters: or a kinematic one).",
    ),
}
