import type { Columns } from "./host";
import type { Vec3 } from "../shared/vectors";

const SECTORS = 72;
const CORNER = 6; // floats per vertex
const [COSINES, SINES] = [Math.cos, Math.sin].map((f) =>
  Float64Array.from({ length: SECTORS + 1 }, (_, k) => f((2 * Math.PI * k) / SECTORS)),
);
const SMOOTH = Math.cos((32 * Math.PI) / 180); // edges with smaller angles are shaded smoothly

/** Triangles of a part: position and normal per vertex. */
export type Mesh = Float32Array;

/** Frame of a part: axes and origin. */
interface Frame {
  axes: [Vec3, Vec3, Vec3];
  origin: Vec3;
}

export function frameOf(block: Columns): Frame {
  const of = (name: string): Vec3 => {
    const c = block.column(name);
    return [c[0], c[1], c[2]];
  };
  return { axes: [of("x"), of("y"), of("z")], origin: of("origin") };
}

/** Create the surface of revolution of a profile; NaN interrupts it. */
export function revolved(profile: Columns, frame: Frame): Mesh {
  const [r, z] = [profile.column("r_mm"), profile.column("z_mm")];
  const strips = Array.from({ length: profile.rows - 1 }, (_, i) => {
    const own = squareTo(r, z, i);
    if (!own) return null;
    const [before, after] = [i - 1, i + 1].map((j) =>
      between(own, j >= 0 && j + 1 < profile.rows ? squareTo(r, z, j) : null),
    );
    return [ring(frame, r[i], z[i], before), ring(frame, r[i + 1], z[i + 1], after)];
  }).filter((strip) => strip !== null);
  const mesh = new Float32Array(strips.length * SECTORS * 6 * CORNER);
  let at = 0;
  for (const [low, high] of strips)
    for (let k = 0; k < SECTORS; k++)
      for (const [from, turn] of [
        [low, k],
        [high, k],
        [high, k + 1],
        [low, k],
        [high, k + 1],
        [low, k + 1],
      ] as const) {
        mesh.set(from.subarray(CORNER * turn, CORNER * (turn + 1)), at);
        at += CORNER;
      }
  return mesh;
}

type Flat = readonly [r: number, z: number];

/** Return the normal of a profile segment; null if it is degenerate or interrupted. */
function squareTo(r: Float32Array, z: Float32Array, i: number): Flat | null {
  const [dr, dz] = [r[i + 1] - r[i], z[i + 1] - z[i]];
  const length = Math.hypot(dr, dz);
  return length > 0 ? [dz / length, -dr / length] : null;
}

/** Return the mean of two normals at a smooth edge. */
function between(own: Flat, other: Flat | null): Flat {
  if (!other || own[0] * other[0] + own[1] * other[1] < SMOOTH) return own;
  const [r, z] = [own[0] + other[0], own[1] + other[1]];
  const length = Math.hypot(r, z);
  return [r / length, z / length];
}

/** Return the ring of a profile point: positions and normals. */
function ring(
  { axes: [x, y, z], origin }: Frame,
  radius: number,
  height: number,
  [across, along]: Flat,
): Float32Array {
  const corners = new Float32Array((SECTORS + 1) * CORNER);
  for (let turn = 0; turn <= SECTORS; turn++)
    for (let i = 0; i < 3; i++) {
      const out = COSINES[turn] * x[i] + SINES[turn] * y[i];
      corners[CORNER * turn + i] = origin[i] + radius * out + height * z[i];
      corners[CORNER * turn + 3 + i] = across * out + along * z[i];
    }
  return corners;
}

/** Return the bounding box of meshes. */
export function boundsOf(meshes: Mesh[]): [low: Vec3, high: Vec3] {
  const [low, high] = [
    [Infinity, Infinity, Infinity],
    [-Infinity, -Infinity, -Infinity],
  ];
  for (const mesh of meshes)
    for (let i = 0; i < mesh.length; i += 6)
      for (let k = 0; k < 3; k++) {
        low[k] = Math.min(low[k], mesh[i + k]);
        high[k] = Math.max(high[k], mesh[i + k]);
      }
  return [low as unknown as Vec3, high as unknown as Vec3];
}

/** Return the twelve edges of each box as segments. */
export function edgesOf(boxes: Columns): [Vec3, Vec3][][] {
  const [low, high] = ["0", "1"].map((end) =>
    ["x", "y", "z"].map((axis) => boxes.column(axis + end)),
  );
  return Array.from({ length: boxes.rows }, (_, i) => {
    const corner = (bits: number): Vec3 =>
      [0, 1, 2].map((k) => (bits & (1 << k) ? high : low)[k][i]) as unknown as Vec3;
    return [0, 1, 2].flatMap((k) =>
      [0, 1, 2, 3, 4, 5, 6, 7]
        .filter((bits) => !(bits & (1 << k)))
        .map((bits): [Vec3, Vec3] => [corner(bits), corner(bits | (1 << k))]),
    );
  });
}
