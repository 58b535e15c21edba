import { byId, h } from "../shared/dom";

/** What the words of this tab mean, and where they stand. */
const WORDS: readonly (readonly [term: string, meaning: string, place: string])[] = [
  [
    "Panorama",
    "all around the sensor on one strip: straight ahead in the middle, behind at both ends",
    '#modes label:has([value="panorama"])',
  ],
  [
    "Perspective",
    "as an ordinary camera in the sensor's place would see it: straight lines are straight",
    '#modes label:has([value="perspective"])',
  ],
  [
    "Dome",
    "up to the sky or down to the ground as a disk: the same angle has the same length everywhere",
    '#modes label:has([value="dome"])',
  ],
  [
    "Little planet",
    "the same, with shapes kept and what is far out made large",
    '#modes label:has([value="planet"])',
  ],
  [
    "Ground plan",
    "the floor as a map seen from above, to scale",
    '#modes label:has([value="ground"])',
  ],
  [
    "Mosaic",
    "a panorama with four perspective views below it",
    '#modes label:has([value="mosaic"])',
  ],
  [
    "Pan, tilt",
    "where the view looks: to the right, and up",
    "#sliders label:has(#pan), #sliders label:has(#tilt)",
  ],
  [
    "Field of view",
    "how wide an angle the view shows from its left to its right",
    "#sliders label:has(#hfov)",
  ],
  [
    "Distance",
    "how far away is what should be seen without parallax: a mirror sees near things from other places than far ones",
    "#sliders label:has(#distance)",
  ],
  [
    "Mirror height",
    "how high the mirror stands over the floor; it makes the plan's scale",
    "#sliders label:has(#height)",
  ],
  [
    "Sensor",
    "the camera with its mirror, or a fisheye: it tells which way each pixel of the picture looks",
    "#sensor",
  ],
  [
    "Circle",
    "where the mirror ends in the picture; a picture is straight once the circle lies on the mirror's edge",
    "#rim-row, #rim-numbers",
  ],
  [
    "Field of the ball",
    "the angle that a mirror ball shows: a whole one 340°, most of one 260°, a bulging one 160°",
    "#ball-row",
  ],
  [
    "Camera looks",
    "which way the camera points, up into a mirror that hangs over it or down into one that stands below",
    "fieldset:has(#looks)",
  ],
  [
    "Forward",
    "which direction of the picture is straight ahead: its angle from the right towards the bottom",
    "label:has(#forward)",
  ],
  [
    "Reversed",
    "mirrored once more, as front cameras of telephones save it: letters are the wrong way round in the view",
    "label:has(#flipped)",
  ],
  [
    "Leaned",
    "how far the sensor stood out of plumb when the picture was taken",
    "fieldset:has(#lean)",
  ],
  ["Elevation", "angle over the horizon; −90° is straight down", "#sensor-words"],
];

/** Explain each word to whoever points at it, and all of them in a list. */
export function explainWords(): void {
  for (const [, meaning, place] of WORDS)
    for (const element of document.querySelectorAll<HTMLElement>(place))
      element.title ||= `${meaning[0].toUpperCase()}${meaning.slice(1)}.`;
  byId("words").append(
    ...WORDS.flatMap(([term, meaning]) => [h("dt", {}, term), h("dd", {}, meaning)]),
  );
}
