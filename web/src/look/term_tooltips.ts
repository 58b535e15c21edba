import { byId, h } from "../shared/dom";

/** Glossary of the tab, with selectors of the explained elements. */
const WORDS: readonly (readonly [term: string, meaning: string, place: string])[] = [
  [
    "Panorama",
    "360° around the sensor; forward in the centre, backward at both ends",
    '#modes label:has([value="panorama"])',
  ],
  [
    "Perspective",
    "undistorted image of a conventional camera at the position of the sensor: straight lines are straight",
    '#modes label:has([value="perspective"])',
  ],
  [
    "Dome",
    "zenith or nadir in the centre of a disk, equidistant projection: equal angles have equal lengths",
    '#modes label:has([value="dome"])',
  ],
  [
    "Little planet",
    "zenith or nadir in the centre, stereographic projection: shapes are preserved and the periphery is enlarged",
    '#modes label:has([value="planet"])',
  ],
  ["Ground plan", "plan view of the floor, to scale", '#modes label:has([value="ground"])'],
  ["Mosaic", "a panorama and four perspective views", '#modes label:has([value="mosaic"])'],
  [
    "Pan, tilt",
    "direction of the view: pan is positive to the right, tilt upwards",
    "#sliders label:has(#pan), #sliders label:has(#tilt)",
  ],
  ["Field of view", "horizontal angle of the view", "#sliders label:has(#hfov)"],
  [
    "Distance",
    "object distance at which the view has no parallax; the viewpoint of a mirror depends on the object distance",
    "#sliders label:has(#distance)",
  ],
  [
    "Mirror height",
    "height of the mirror above the floor; determines the scale of the plan",
    "#sliders label:has(#height)",
  ],
  [
    "Sensor",
    "the camera with its mirror, or a fisheye camera; determines the direction of each pixel",
    "#sensor",
  ],
  [
    "Circle",
    "outline of the mirror in the image; views are correct if the circle coincides with it",
    "#rim-row, #rim-numbers",
  ],
  [
    "Field of view of the ball",
    "field of view of a mirror ball: complete sphere 340°, mirror dome 260°, convex mirror 160°",
    "#ball-row",
  ],
  [
    "Optical axis points",
    "orientation of the camera: up towards a mirror above it, or down towards a mirror below it",
    "fieldset:has(#looks)",
  ],
  [
    "Forward",
    "image direction of the forward axis, as an angle from image right, clockwise",
    "label:has(#forward)",
  ],
  [
    "Flipped",
    "images of front cameras of phones are often flipped; text in the view is then mirrored",
    "label:has(#flipped)",
  ],
  [
    "Tilt of the sensor",
    "deviation of the sensor from the vertical when the image was captured",
    "fieldset:has(#lean)",
  ],
  ["Elevation", "angle above the horizon; −90° is the nadir", "#sensor-words"],
];

/** Set tooltips, and fill the glossary. */
export function explainWords(): void {
  for (const [, meaning, place] of WORDS)
    for (const element of document.querySelectorAll<HTMLElement>(place))
      element.title ||= `${meaning[0].toUpperCase()}${meaning.slice(1)}.`;
  byId("words").append(
    ...WORDS.flatMap(([term, meaning]) => [h("dt", {}, term), h("dd", {}, meaning)]),
  );
}
