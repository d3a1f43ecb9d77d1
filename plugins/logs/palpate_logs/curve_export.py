"""Force curves exported by afmformats, whose endings are those of any table with tabs and of any HDF5 file."""

from __future__ import annotations

from pathlib import Path

TEXT, HDF5 = ".tab", ".h5"
_METADATA_MARK = b"# BEGIN METADATA"
_MARK_BYTES = 1 << 16  # at the beginning of a file, which hold the mark: a choice, far more than a line of names


def is_exported_curve(path: Path) -> bool:
    """Return True for a text or HDF5 file with the metadata of a force curve."""
    name = path.name.lower()
    if name.endswith(TEXT):
        with path.open("rb") as file:
            return _METADATA_MARK in file.read(_MARK_BYTES)
    return name.endswith(HDF5) and _is_hdf5_of_curves(path)


def _is_hdf5_of_curves(path: Path) -> bool:
    """Return True for an HDF5 file whose groups are curves by their numbers; without h5py, for any HDF5 file."""
    try:
        import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        return True
    try:
        with h5py.File(path, "r") as file:
            return "software version" in file.attrs and any(str(name).isdecimal() for name in file)
    except OSError:
        return False
