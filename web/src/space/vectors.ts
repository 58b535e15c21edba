/** 3-vectors, and 4 x 4 matrices in column-major order as in WebGL. */

export type Vec3 = readonly [number, number, number];
export type Matrix = Float32Array;

export const add = (a: Vec3, b: Vec3, times = 1): Vec3 => [
  a[0] + times * b[0],
  a[1] + times * b[1],
  a[2] + times * b[2],
];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
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
