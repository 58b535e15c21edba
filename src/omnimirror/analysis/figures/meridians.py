"""Comparison of mirrors: profiles, and image heights against field angles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ...optics.tracing.meridian import Meridian
from .labels import EndLabels
from .style import PAGE, PALETTE, angle_axis, grid_of_axes, new_figure, panel_title, styled

POINTS = 400


def meridian_curves(mirrors: Mapping[str, Meridian]) -> Figure:
    """Draw up to six mirrors by name, with lengths in rim radii."""
    with styled():
        figure = new_figure(PAGE, 2.9)
        sections, heights = grid_of_axes(figure, 1, 2, 2)
        labels = EndLabels(figure)
        for (name, meridian), colour in zip(mirrors.items(), PALETTE, strict=False):
            M = meridian.mirror.rim_radius_mm
            rays = meridian.trace(np.linspace(0.0, M, POINTS))
            h = rays.x / M if np.isinf(meridian.m) else rays.x / rays.w / np.tan(meridian.theta_max)
            (section,) = sections.plot(rays.x / M, rays.z / M, color=colour, gid=f"{name}:section")
            heights.plot(np.degrees(rays.omega), h, color=colour, gid=f"{name}:height")
            labels.of_line(sections, section, name)
        panel_title(sections, 0, "Sections, the lens far below")
        sections.set_xlim(0, 1)
        sections.set_xlabel("Distance from the axis x/M")
        sections.set_ylabel("Height over the vertex z/M")
        panel_title(heights, 1, "Image height")
        angle_axis(heights, max(float(np.degrees(m.omega_max)) for m in mirrors.values()))
        heights.set_ylim(0, 1)
        heights.set_ylabel("h / h of the rim")
        return labels.settle()
