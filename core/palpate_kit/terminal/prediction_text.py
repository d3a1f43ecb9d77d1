"""The prediction of one part of a record by the other, in words."""

HALF, BLOCK = "the fit of the first half predicts the second half", "every second block predicts the others"
MIN_SHOWN = 5e-4  # of the force, half of the last digit that is shown


def prediction_text(error: float, parts: str) -> str:
    """Return a sentence on the prediction of one part by the other, with its error relative to the mean force.

    >>> prediction_text(0.0412, BLOCK), prediction_text(1e-5, HALF)[-18:]
    ('every second block predicts the others within 4.1 % of the force', 'noise of the force')
    """
    size = f"within {100 * error:.1f} % of the force" if error >= MIN_SHOWN else "to the noise of the force"
    return f"{parts} {size}"
