"""The registration file: the pose of a mesh by touches, with its covariance; TOML, SI inside."""

from __future__ import annotations

import hashlib
from datetime import datetime
from pathlib import Path

import numpy as np
from palpate import ConfigurationError, Settings
from palpate_kit.runs.toml_file import read_settings
from pydantic import Field

from palpate_surfaces.pose import UncertainPose

_FORMAT = 1
_Vector = tuple[float, float, float]
_Row = tuple[float, float, float, float, float, float]


class Registration(Settings):
    """A registration, as in its file."""

    format: int = Field(default=_FORMAT, ge=1, le=_FORMAT, description="version of this format")
    created: datetime = Field(description="when it was made, with time zone")
    mesh: str = Field(description="SHA-256 of the mesh's file")
    touches: int = Field(ge=0, description="touches that it is made of, those of former registrations included")
    sources: tuple[str, ...] = Field(description="SHA-256 of each table or result of a run with these touches")
    rotation: _Vector = Field(description="rotation vector from the mesh's frame to the work frame [rad]")
    position: _Vector = Field(description="origin of the mesh's frame in the work frame [m]")
    pivot: _Vector = Field(description="point of the work frame about which the covariance counts turns [m]")
    covariance: tuple[_Row, _Row, _Row, _Row, _Row, _Row] = Field(description="of displacement [m] and turn [rad]")
    residual: float = Field(ge=0, description="root mean square of the touches' distances from the surface [m]")
    open: tuple[str, ...] = Field(default=(), description="directions that the touches leave as they were")

    @property
    def pose(self) -> UncertainPose:
        """The pose with its covariance."""
        vectors = (np.array(self.rotation), np.array(self.position), np.array(self.pivot))
        return UncertainPose(*vectors, np.array(self.covariance))

    def text(self) -> str:
        """Return the file's text."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="python"))


def read_registration(path: Path, mesh: str) -> Registration:
    """Return a registration file; `mesh` is the SHA-256 of the mesh's file.

    Raises ConfigurationError for an invalid registration, or one of another mesh.
    """
    registration = read_settings(path, Registration, "registration")
    covariance = registration.pose.covariance
    numbers = np.concatenate([registration.pose.rotation, registration.pose.translation, covariance.ravel()])
    # `eigvalsh` is of finite numbers only, and sorts the smallest eigenvalue first.
    if not np.isfinite(numbers).all() or np.linalg.eigvalsh((covariance + covariance.T) / 2)[0] <= 0:
        raise ConfigurationError(f"{path}: is not a registration: its pose or covariance is not one of finite numbers")
    if registration.mesh != mesh:
        raise ConfigurationError(f"{path}: it registers another mesh; touch this one and register it again")
    return registration


def file_digest(file: Path) -> str:
    """Return the SHA-256 of a file; raises ConfigurationError where it cannot be read."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise ConfigurationError(f"{file}: cannot read: {error.strerror}") from error
