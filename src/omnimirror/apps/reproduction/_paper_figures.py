"""Diagrams, photographs and dewarped images of the paper: Figs. 1, 2, 13, 14 and 16 to 18.

Rendered images of a room replace the photographs of the paper, which show a garden and the
prototypes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

from matplotlib.figure import Figure

from ...analysis.figures import image_and_views, sensor_diagrams
from ...analysis.figures.sensor_diagrams import ImageArray, Prototype
from ...analysis.focus import best_viewpoint
from ...dewarp import Dewarper, views
from ...optics.housing import CameraBody, Dome, Housing, Rod, Tube
from ...optics.image_sensor import Imager
from ...optics.sensor import Sensor
from ...simulation.pixel_rays import ThroughShell
from ...simulation.rendering import SHOWN_SAMPLES, render_image
from ...simulation.scenes.room import Room
from ._paper_sensors import M, paper_sensors

CAMERA_RADIUS_MM = 20.0  # body of the cameras of the prototypes
PANEL_PX, PANEL_SAMPLES = 360, 8  # resolution of a panel of Fig. 16 in print, rays per pixel


def _sphere() -> Sensor:
    return paper_sensors()[0]


@cache
def _circle() -> ImageArray:
    """Render the room with the spherical sensor through its whole aperture, as recorded by its
    camera."""
    return render_image(_sphere(), Room(), samples=SHOWN_SAMPLES, blur=True, low_pass=True)


def fig1() -> Figure:
    return sensor_diagrams.principle(_sphere(), _circle())


def fig2() -> Figure:
    return sensor_diagrams.design(_sphere())


def fig13() -> Figure:
    sensor = _sphere()
    flat = (views.panorama(sensor), views.dome(sensor))
    return sensor_diagrams.virtual_screens(
        sensor, [Dewarper(sensor, view)(_circle()) for view in flat]
    )


def fig14() -> Figure:
    sensor = _sphere()
    return sensor_diagrams.single_viewpoint(sensor, best_viewpoint(sensor, 3 * M).z_mm)


def fig16() -> Figure:
    """Draw the prototypes of Sec. 5.2; the paper prints no dimensions, these are assumed.

    The clear rod tapers towards the lens along the chief rays; its image equals that of the bare
    mirror with the camera in the centre. Images have the resolution of the printed panels.
    """
    sphere = _sphere()
    pitch = sphere.imager.pixel_pitch_um * sphere.imager.width_px / PANEL_PX
    imager = Imager(PANEL_PX, PANEL_PX, pitch)
    room, bare = (
        Room(),
        replace(sphere, imager=imager, housing=Housing(CameraBody(2 * CAMERA_RADIUS_MM))),
    )
    lens = -bare.meridian.m
    rod, tube, dome = (
        Rod(1.4, 14.0, gap_mm=-0.1 * lens),
        Tube(110.0, 3.0),
        Dome(150.0, 3.0, centre_mm=20.0),
    )
    scenes = (
        room,
        ThroughShell(room, tube, bare, lids_mm=(lens,)),
        ThroughShell(room, dome, bare),
    )  # lid of the tube
    images = [render_image(bare, scene, samples=PANEL_SAMPLES) for scene in scenes]
    housings = [
        replace(bare.housing, rod=rod),
        replace(bare.housing, shell=tube),
        replace(bare.housing, shell=dome),
    ]
    titles = ("Bare, on a clear rod", "In a clear tube", "In a clear globe")
    return sensor_diagrams.prototypes(
        [Prototype(bare, *each) for each in zip(titles, images, housings, strict=True)]
    )


def fig17() -> Figure:
    """Draw a furnished room instead of the garden: circle, panorama, zoom."""
    sensor = _sphere()
    panorama = Dewarper(sensor, views.panorama(sensor), "cubic")(_circle())
    zoom = Dewarper(sensor, views.perspective((1120, 840), hfov_deg=75.0), "cubic")(_circle())
    return image_and_views(_circle(), panorama, zoom)


def fig18() -> Figure:
    return sensor_diagrams.blur_geometry()


DIAGRAMS: dict[str, Callable[[], Figure]] = {
    f.__name__: f for f in (fig1, fig2, fig13, fig14, fig16, fig17, fig18)
}
"""Figures other than evaluation curves, by name."""
