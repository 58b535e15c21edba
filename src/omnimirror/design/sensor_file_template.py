"""Template of a sensor file: a valid sensor, with a list of all parts and their entries."""

from __future__ import annotations

from collections.abc import Mapping

from ..base.arguments import instance, validate_arguments
from ..base.escaping import toml_string
from ..base.parameters import Parameter
from ..base.project import schema_directive
from ..optics.image_sensor import ImagerPose
from ..optics.lenses import LENSES, Lens
from ..optics.mirrors import MIRRORS, Mirror, Secondary
from ..optics.mirrors.mirror import MirrorPose
from ..optics.sensor_files import HOUSING_PARTS
from ..optics.thermal import Thermal


@validate_arguments
def sensor_template(name: str = "sensor") -> str:
    """Return the text of a valid sensor file with explanations of all entries and parts.

    Written by ``omnimirror init``.

    Parameters
    ----------
    name
        Name of the sensor.

    Returns
    -------
    str
        Text of the file in TOML format.

    Raises
    ------
    TypeError
        If the name is not a string.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.parse_sensor(om.sensor_template("mine")).mirror
    Sphere(radius_mm=50.0, rim_radius_mm=44.0)
    """
    instance("name", name, str, "a name")
    directive = schema_directive("sensor")
    return f'''{directive}# Sensor: a curved mirror and a camera on its axis.
# Lengths in mm unless the name specifies another unit.
format = 1
name = {toml_string(name)}
notes = """
Description of the sensor and source of its parameters."""

[mirror]
kind = "sphere"
radius_mm = 50.0
rim_radius_mm = 44.0
# Kinds of mirrors and their entries (z increases away from the lens; the vertex is at z = 0):
{_catalogue(MIRRORS)}

[lens]
kind = "perspective"
focal_length_mm = 11.6
f_number = 4.0
focus_distance_mm = 218.0  # from the principal point to the virtual images; optimum: `omnimirror evaluate`
# Kinds of lenses and their entries:
{_catalogue(LENSES)}

[imager]
width_px = 1024
height_px = 1024
pixel_pitch_um = 5.2
# centre_px = [511.5, 511.5]  # image of the axis, (u, v); default: the centre of the array

[mount]
mirror_distance_mm = 185.93  # m: from the principal point of the lens to the mirror vertex
camera_looks = "up"  # "up": the mirror is above the camera; "down"; or "forward" (horizontal)
forward_azimuth_deg = -90.0  # image direction that is forward: 0 = image right, -90 = image top
image_flipped = false  # true if the driver delivers images mirrored left to right
# pitch_deg = 0.0  # tilt of the sensor: elevation of its forward direction
# roll_deg = 0.0  # clockwise rotation about the forward direction, viewed from behind

# [secondary]  # secondary mirror between lens and primary; any kind of mirror, in the frame of the camera, or flat
# kind = "flat"
# rim_radius_mm = 21.0
{_entries(Secondary.PARAMETERS, SECONDARY)}

# [mirror_pose]  # misalignment of the mirror; camera frame, tilts about the vertex
{_entries(MirrorPose.PARAMETERS)}

# [mirror_form]  # form error of the mirror: Zernike terms over the disc of the rim (Noll indices), um rms
# zernike = [5, 8]
# um = [0.3, -0.1]

# [imager_pose]  # rotation of the imager in its plane, then its tilt
{_entries(ImagerPose.PARAMETERS)}

{_thermal()}

# Housing of the mirror; omitted sizes are adapted to the sensor.
{_housing()}
'''


SECONDARY = {"distance_mm": 88.0, "bore_radius_mm": 5.0}
"""Valid fold mirror for the sensor of the template."""


def _entries(parameters: Mapping[str, Parameter], values: Mapping[str, float] | None = None) -> str:
    """Format the optional entries of a table as comments, 0 unless ``values`` contains them."""
    values = values or {}
    return "\n".join(
        f"# {name} = {values.get(name, 0.0)}  # {p.description}" for name, p in parameters.items()
    )


HOUSING = {
    "camera": {"diameter_mm": 30.0},
    "rod": {"gap_mm": 45.0},
    "tube": {"diameter_mm": 102.0},
    "rim": {"width_mm": 1.5},
}
"""Valid housing for the sensor of the template; missing values default to those of the parts."""


def _thermal() -> str:
    """Format the commented table of thermal properties."""
    thermal = Thermal(
        mirror_material="acrylic", spacer_material="aluminium", mount_material="aluminium"
    )
    entries = {name: v for name in thermal.PARAMETERS if (v := getattr(thermal, name)) is not None}
    lines = [
        f"# {name} = {toml_string(v) if isinstance(v, str) else v}" for name, v in entries.items()
    ]
    return "\n".join(["# [thermal]  # materials, for other temperatures", *lines])


def _housing() -> str:
    """Format the commented tables of a housing."""
    tables = []
    for name, values in HOUSING.items():
        part = HOUSING_PARTS[name](**values)
        entries_of_part = {n: v for n in part.PARAMETERS if (v := getattr(part, n)) is not None}
        entries = "\n".join(
            f"# {n} = {v}  # {part.PARAMETERS[n].description}" for n, v in entries_of_part.items()
        )
        tables.append(f"# [housing.{name}]\n{entries}")
    return "\n".join(tables)


def _catalogue(parts: Mapping[str, type[Mirror] | type[Lens]]) -> str:
    """Format one commented block for each kind, from its parameter descriptions."""
    lines: list[str] = []
    for kind, cls in parts.items():
        lines.append(f'#   kind = "{kind}"')
        parameters = cls.PARAMETERS
        lines += [
            f"#     {name}: {p.description}{f', {p.unit}' if p.unit else ''}"
            for name, p in parameters.items()
        ]
        if kind == "sampled":
            lines.append(
                "#     or profile_csv: a file in the same folder with the columns x_mm, z_mm; cloud_csv: x, y, z"
            )
            lines.append("#     anywhere on the mirror; grid_sag: an OpticStudio grid")
        if kind in ("table", "surfaces"):
            file = "a CSV of these columns" if kind == "table" else "a .zmx file"
            lines.append(f"#     or file: {file} in the same folder")
        if kind == "tabulated-mapping":
            lines.append(
                "#     or mapping_csv: a file in the same folder with the columns omega_deg, height"
            )
    return "\n".join(lines)
