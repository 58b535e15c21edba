/** Sums of vectors, and 4 x 4 matrices in column-major order as in WebGL. */

import type { Vec3 } from "../shared/vectors";

export type Matrix = Float32Array;

export const add = (a: Vec3, b: Vec3, times = 1): Vec3 => [
  a[0] + times * b[0],
  a[1] + times * b[1],
  a[2] + times * b[2],
];
export const unit = (a: Vec3): Vec3 => {
  const length = Math.hypot(...a) || 1;
  return [a[0] / length, a[1] / length, a[2] / length];
};

/** Multiply a matrix and a point: homogeneous x, y, z, w. */
export const transformed = (m: Matrix, [x, y, z]: Vec3): [number, number, number, number] => {
  const row = (i: number): number => m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i];
  return [row(0), row(1), row(2), row(3)];
};
