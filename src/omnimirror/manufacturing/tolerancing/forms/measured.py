"""A form that was measured on a mirror, as an error that others of its making have."""

from __future__ import annotations

from pathlib import Path

from ....arguments import checked
from ....errors import InvalidParameter
from ....mirrors import Mirror
from ....mirrors.form import TERMS, MirrorForm
from ...metrology.form_errors import form_error
from ...metrology.readers import Unit, read_points

LEAST_UM = 1e-6  # rms: what is smaller is rounding


@checked
def measured_form(mirror: Mirror, path: str | Path, unit: Unit = "mm") -> MirrorForm:
    """The form error that was measured on a mirror, up to Zernike terms of order 12.

    Parameters
    ----------
    mirror
        That was meant.
    path
        Of a cloud or grid of points, as :func:`omnimirror.manufacturing.metrology.readers.read_points` reads them.
    unit
        Of points by the line.

    Returns
    -------
    MirrorForm
        The terms that the points tell, beside the place of the mirror in the machine and their noise.

    Raises
    ------
    OmnimirrorError
        The file is missing or holds no points, or too few.
    InvalidParameter
        The points show no form error at all.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from omnimirror.mirrors import Sphere
    >>> ball, (x, y) = Sphere(50.0, 44.0), (v.ravel() for v in np.meshgrid(*2 * [np.linspace(-31, 31, 41)]))
    >>> z = ball.sag(np.hypot(x, y)) + 1e-3 * np.sqrt(6) * (x**2 - y**2) / 44**2  # 1 um of astigmatism
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/cmm.csv", np.stack([x, y, z], axis=-1), delimiter=",")
    ...     form = measured_form(ball, f"{folder}/cmm.csv")
    >>> round(dict(zip(form.zernike, form.um))[6], 4)
    1.0
    """
    found = form_error(mirror, read_points(path, unit))
    terms = [term for term in found.terms if 1 < term.noll <= TERMS and abs(term.um) > max(term.sigma_um, LEAST_UM)]
    if not terms:
        raise InvalidParameter(f"{path} shows no form error beyond its noise of {found.noise_um:.3g} um")
    return MirrorForm(tuple(term.noll for term in terms), tuple(term.um for term in terms))
