"""Force curves exported by afmformats, whose endings are those of any table with tabs and of any HDF5 file."""

from __future__ import annotations

from pathlib import Path

TEXT, HDF5 = ".tab", ".h5"
_METADATA = b"# BEGIN METADATA"
_HEAD = 1 << 16  # [bytes] in which the metadata begin


def is_exported_curve(path: Path) -> bool:
    """Return True for a file of one of these endings with the metadata of a force curve."""
    name = path.name.lower()
    if name.endswith(TEXT):
        with path.open("rb") as file:
            return _METADATA in file.read(_HEAD)
    return name.endswith(HDF5) and _is_hdf5_of_curves(path)


def _is_hdf5_of_curves(path: Path) -> bool:
    """Return True for an HDF5 file whose groups are curves; so is any where h5py is missing."""
    try:
        import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        return True
    try:
        with h5py.File(path, "r") as file:
            return "software version" in file.attrs and any(str(name).isdecimal() for name in file)
    except OSError:
        return False
