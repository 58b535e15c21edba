import { STEPS_IN_SPACE, type Camera } from "../geometry/camera";
import type { Part } from "../geometry/views";

/** Inputs, constants and expressions common to the shaders in GLSL and WGSL. */

/** Uniforms and their types, by decreasing alignment: a buffer of them has no gaps. */
export const UNIFORMS = {
  frame: "mat3",
  axes: "mat3",
  numbers: "vec4",
  image_size: "vec2",
  size: "vec2",
  corner: "vec2",
  ends: "vec2",
  centre: "vec2",
  own_centre: "vec2",
  scale: "float",
  eye: "float",
  distance_mm: "float",
  shape: "int",
  is_point: "bool",
  has_origins: "bool",
  has_starts: "bool",
  has_lattice: "bool",
  wants_coordinates: "bool",
  is_preview: "bool",
} as const;

export type UniformName = keyof typeof UNIFORMS;
/** Values of uniforms; matrices by columns. */
export type UniformValues = Partial<Record<UniformName, number | boolean | readonly number[]>>;

/** Return the values of a camera and its image. */
export function cameraValues(camera: Camera, imageSize: readonly [number, number]): UniformValues {
  const { axis, right, down, tables, centre_px } = camera.model;
  const rows = [axis, right, down];
  return {
    frame: [0, 1, 2].flatMap((column) => rows.map((row) => row[column])),
    image_size: imageSize,
    ends: [tables.first, tables.last],
    centre: [camera.circle.u, camera.circle.v],
    own_centre: centre_px,
    scale: camera.scale,
    eye: tables.viewpoint_mm,
    has_origins: tables.origins > 0,
    has_starts: tables.starts > 0,
    has_lattice: tables.lattice > 0,
  };
}

/** Return the values of a part; `bottom` is its distance from the bottom of the view. */
export const partValues = (part: Part, bottom: number): UniformValues => ({
  size: [part.width, part.height],
  corner: [part.left, bottom],
  axes: part.axes.flat(),
  numbers: part.numbers,
  distance_mm: part.distance,
  shape: part.shape,
  is_point: part.isPoint,
});

export const TABLES = ["radii", "lattice", "limits", "starts"] as const;

/** Table of a camera: texture of 32-bit floats with 1, 2 or 4 components. */
export interface Table {
  name: (typeof TABLES)[number];
  width: number;
  height: number;
  components: 1 | 2 | 4;
  values: Float32Array;
}

/** Return the tables of a camera: radii and ray origins by sin(Omega/2), or a lattice for cameras without rotational symmetry. */
export function tablesOf({ model, tables }: Camera): Table[] {
  const { lattice, limits, starts, radii, origins } = model.tables;
  const part = (from: number, count: number): Float32Array => tables.subarray(from, from + count);
  if (!lattice) {
    const values = new Float32Array(4 * radii);
    for (let i = 0; i < radii; i++)
      for (let column = 0; column < (origins ? 3 : 1); column++)
        values[4 * i + column] = tables[column * radii + i];
    return [{ name: "radii", width: radii, height: 1, components: 4, values }];
  }
  const nodes = 2 * lattice * lattice;
  const found: Table[] = [
    { name: "lattice", width: lattice, height: lattice, components: 2, values: part(0, nodes) },
    { name: "limits", width: limits, height: 1, components: 1, values: part(nodes, limits) },
  ];
  if (!starts) return found;
  const values = new Float32Array(4 * starts * starts);
  for (let i = 0; i < starts * starts; i++)
    for (let k = 0; k < 3; k++) values[4 * i + k] = tables[nodes + limits + 3 * i + k];
  return [...found, { name: "starts", width: starts, height: starts, components: 4, values }];
}

/** Constants: steps of the ray origin without symmetry; the kernel of Keys in the pixel convention of OpenCV and omnimirror; the limits of averaging in omnimirror.dewarp.sampling, where sides up to SHARP are reduced to zero, with a smooth transition above. */
export const CONSTANTS = {
  integers: { ROUGH_STEPS: STEPS_IN_SPACE, FINE_STEPS: 4, MAX_TAPS: 16 },
  numbers: { KEYS_A: "-0.75", KEYS_A_LATTICE: "-0.5", SHARP: "1.2", SPACING: "1.5" },
};

/** Sine and cosine of the remainder r of a quarter turn, where q = r * r, in full float precision; those of GPUs can be off by 5e-4, 0.25 px at the rim. */
export const QUARTER_TURNS = "floor(x * 0.6366197723675814 + 0.5)";
export const REMAINDER = "(x - k * 1.5707963705062866) + k * 4.371139e-8";
export const SINE =
  "r + r * q * (-0.16666666 + q * (0.008333331 + q * (-0.00019840874 + q * 2.7525562e-6)))";
export const COSINE =
  "1.0 + q * (-0.5 + q * (0.04166666 + q * (-0.0013888397 + q * 2.4760495e-5)))";

/** Weights of the bicubic kernel of Keys at x = 1 + t, t, y = 1 - t and z = 2 - t. */
export const KEYS_WEIGHTS = `
    ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a,
    ((a + 2.0) * t - (a + 3.0)) * t * t + 1.0,
    ((a + 2.0) * y - (a + 3.0)) * y * y + 1.0,
    ((a * z - 5.0 * a) * z + 8.0 * a) * z - 4.0 * a
  `;
