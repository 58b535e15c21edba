import { clamp } from "../shared/numbers";
import { cross, dot, type Vec3 } from "../shared/vectors";
import { add, type Matrix, unit } from "./vectors";

const FIELD = (34 * Math.PI) / 180; // vertical field of view
const MAX_ELEVATION = (89.5 * Math.PI) / 180;
const [MIN_DISTANCE, MAX_DISTANCE] = [1e-3, 1e7]; // mm
const NEAR_SHARE = 0.02; // near plane, relative to the distance
const BEYOND = 20_000; // far plane behind the target, mm
const UP: Vec3 = [0, 0, 1];

/** Orbit camera; the vertical remains vertical. */
export interface Orbit {
  target: Vec3;
  distance: number;
  /** Radians: azimuth from forward to the left, and elevation. */
  around: number;
  above: number;
}

/** Axes of the screen in space. */
interface Axes {
  eye: Vec3;
  right: Vec3;
  up: Vec3;
  forward: Vec3;
}

export function axesOf({ target, distance, around, above }: Orbit): Axes {
  const back: Vec3 = [
    Math.cos(above) * Math.cos(around),
    Math.cos(above) * Math.sin(around),
    Math.sin(above),
  ];
  const forward = unit([-back[0], -back[1], -back[2]]);
  const right = unit(cross(forward, UP));
  return { eye: add(target, back, distance), right, up: cross(right, forward), forward };
}

/** Return the distance of the near plane, mm. */
export const nearOf = (orbit: Orbit): number => NEAR_SHARE * orbit.distance;

/** Return the projection matrix for an aspect ratio. */
export function matrixOf(orbit: Orbit, aspect: number): Matrix {
  const { eye, right, up, forward } = axesOf(orbit);
  const zoom = 1 / Math.tan(FIELD / 2);
  const [near, far] = [nearOf(orbit), orbit.distance + BEYOND];
  const [a, b] = [(far + near) / (far - near), (-2 * far * near) / (far - near)];
  const rows = [
    scaled(right, zoom / aspect, eye),
    scaled(up, zoom, eye),
    [...forward.map((c) => a * c), b - a * dot(forward, eye)],
    [...forward, -dot(forward, eye)],
  ];
  return Float32Array.from({ length: 16 }, (_, i) => rows[i % 4][Math.floor(i / 4)]);
}

const scaled = (axis: Vec3, by: number, eye: Vec3): number[] => [
  ...axis.map((c) => by * c),
  -by * dot(axis, eye),
];

/** Rotate about the target, radians. */
export const turned = (o: Orbit, around: number, above: number): Orbit => ({
  ...o,
  around: o.around + around,
  above: clamp(o.above + above, -MAX_ELEVATION, MAX_ELEVATION),
});

export const nearer = (o: Orbit, times: number): Orbit => ({
  ...o,
  distance: clamp(o.distance / times, MIN_DISTANCE, MAX_DISTANCE),
});

/** Move the target to the right and up, in screen heights. */
export function moved(o: Orbit, right: number, up: number): Orbit {
  const axes = axesOf(o);
  const height = 2 * Math.tan(FIELD / 2) * o.distance;
  return { ...o, target: add(add(o.target, axes.right, right * height), axes.up, up * height) };
}

/** Look at a box from a distance at which it is completely visible. */
export function fitting(o: Orbit, low: Vec3, high: Vec3, aspect: number): Orbit {
  const above = clamp(o.above, -MAX_ELEVATION, MAX_ELEVATION);
  const target: Vec3 = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2];
  const radius = Math.hypot(...add(high, low, -1)) / 2;
  return { ...o, above, target, distance: radius / Math.sin(FIELD / 2) / Math.min(1, aspect) };
}
