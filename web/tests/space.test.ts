/** Computations of the 3-D view: screen positions, surfaces of revolution, selection of rays. */
import { expect, test } from "vitest";
import type { Columns } from "../src/space/host";
import { axesOf, fitting, matrixOf, moved, nearer, type Orbit, turned } from "../src/space/orbit";
import { nearest, raysOf } from "../src/space/rays";
import { boundsOf, edgesOf, frameOf, revolved } from "../src/space/shapes";
import type { Vec3 } from "../src/shared/vectors";
import { transformed } from "../src/space/vectors";

const ORBIT: Orbit = { target: [10, -20, 30], distance: 400, around: 0.7, above: 0.3 };
const columns = (name: string, of: Record<string, number[]>): Columns => ({
  name,
  rows: Object.values(of)[0].length,
  column: (c) => Float32Array.from(of[c]),
});
const UPRIGHT = frameOf(
  columns("frame", { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], origin: [0, 0, 0] }),
);

const onScreen = (orbit: Orbit, place: Vec3, aspect = 2): [number, number, number] => {
  const [x, y, z, w] = transformed(matrixOf(orbit, aspect), place);
  return [x / w, y / w, z / w];
};

test("what is looked at stands in the middle, and what is higher is higher", () => {
  const [x, y] = onScreen(ORBIT, ORBIT.target);
  expect(x).toBeCloseTo(0, 5);
  expect(y).toBeCloseTo(0, 5);
  expect(onScreen(ORBIT, [10, -20, 50])[1]).toBeGreaterThan(0.05);
  const { right, up, forward } = axesOf(ORBIT);
  expect(right[2]).toBeCloseTo(0, 12);
  const [a, b] = [
    onScreen(ORBIT, ORBIT.target.map((c, i) => c + 10 * right[i]) as unknown as Vec3),
    onScreen(ORBIT, ORBIT.target.map((c, i) => c + 10 * up[i]) as unknown as Vec3),
  ];
  expect(a[0]).toBeCloseTo(b[1] / 2, 5); // aspect ratio 2
  expect(
    onScreen(ORBIT, ORBIT.target.map((c, i) => c + 50 * forward[i]) as unknown as Vec3)[2],
  ).toBeGreaterThan(onScreen(ORBIT, ORBIT.target)[2]);
});

test("turning keeps the distance, moving keeps the direction, and both keep up upright", () => {
  const far = (o: Orbit): number => Math.hypot(...axesOf(o).eye.map((c, i) => c - o.target[i]));
  expect(far(turned(ORBIT, 2, -9))).toBeCloseTo(400, 9);
  expect(turned(ORBIT, 0, 9).above).toBeLessThan(Math.PI / 2);
  const aside = moved(ORBIT, 0.25, 0);
  expect(axesOf(aside).forward).toEqual(axesOf(ORBIT).forward);
  expect(onScreen(aside, ORBIT.target, 1)[0]).toBeCloseTo(-0.5, 5); // 1/4 of the screen height
  expect(nearer(ORBIT, 2).distance).toBe(200);
  expect(nearer(ORBIT, 1e30).distance).toBeGreaterThan(0);
});

test("what is to be seen whole is: every corner of a box, on wide and tall screens", () => {
  const [low, high]: Vec3[] = [
    [-40, -30, -180],
    [50, 60, 20],
  ];
  for (const aspect of [0.5, 1, 2.5])
    for (const around of [0, 1, 4])
      for (let corner = 0; corner < 8; corner++) {
        const place = [0, 1, 2].map((k) => (corner & (1 << k) ? high : low)[k]) as unknown as Vec3;
        const [x, y] = onScreen(fitting({ ...ORBIT, around }, low, high, aspect), place, aspect);
        expect(Math.max(Math.abs(x), Math.abs(y))).toBeLessThan(1);
      }
});

/** Area of the triangles of a mesh. */
function area(mesh: Float32Array): number {
  let sum = 0;
  for (let i = 0; i < mesh.length; i += 18) {
    const [a, b, c] = [0, 6, 12].map((k) => [...mesh.slice(i + k, i + k + 3)]);
    const [u, v] = [b.map((x, k) => x - a[k]), c.map((x, k) => x - a[k])];
    sum +=
      Math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) /
      2;
  }
  return sum;
}

test("a half circle turned is a sphere, and its directions lead away from the middle", () => {
  const addsHistory = Array.from({ length: 61 }, (_, i) => (Math.PI * i) / 60);
  const mesh = revolved(
    columns("ball", {
      r_mm: addsHistory.map((t) => 5 * Math.sin(t)),
      z_mm: addsHistory.map((t) => -5 * Math.cos(t)),
    }),
    UPRIGHT,
  );
  expect(area(mesh) / (100 * Math.PI)).toBeCloseTo(1, 2);
  for (let i = 0; i < mesh.length; i += 6 * 997) {
    const along = [0, 1, 2].reduce((sum, k) => sum + mesh[i + k] * mesh[i + 3 + k], 0);
    expect(along).toBeGreaterThan(4.98);
  }
});

test("edges stay sharp, breaks stay open, and parts stand in their frames", () => {
  const cup = revolved(
    columns("cup", { r_mm: [0, 3, 3, NaN, 2, 2], z_mm: [0, 0, 4, NaN, 0, 1] }),
    UPRIGHT,
  );
  expect(area(cup)).toBeCloseTo(Math.PI * (9 + 24 + 4), -0.5);
  const directions = new Set(
    Array.from({ length: cup.length / 6 }, (_, i) => Math.abs(Math.round(cup[6 * i + 5]))),
  );
  expect([...directions].sort()).toEqual([0, 1]); // perpendicular or parallel to the axis
  const frame = frameOf(
    columns("frame", { x: [0, 1, 0], y: [-1, 0, 0], z: [0, 0, -1], origin: [7, 8, 9] }),
  );
  const [low, high] = boundsOf([
    revolved(columns("cup", { r_mm: [0, 3, 3], z_mm: [0, 0, 4] }), frame),
  ]);
  expect(low.map(Math.round)).toEqual([4, 5, 5]);
  expect(high.map(Math.round)).toEqual([10, 11, 9]);
});

test("a box has twelve edges, each along one axis", () => {
  const [edges] = edgesOf(
    columns("room", { x0: [-1], y0: [-2], z0: [-3], x1: [1], y1: [2], z1: [3] }),
  );
  expect(edges.length).toBe(12);
  const lengths = edges.map(([a, b]) => b.map((c, k) => c - a[k]));
  expect(
    lengths
      .map((l) => l.filter((c) => c !== 0))
      .flat()
      .sort(),
  ).toEqual([2, 2, 2, 2, 4, 4, 4, 4, 6, 6, 6, 6]);
});

const NODES = ["lens", "second", "mirror", "wall", "end"];

/** Rays from the lens via a mirror point to an end; the mirror is 100 mm above the lens. */
function table(ends: Vec3[]): Columns {
  const of: Record<string, number[]> = {
    omega_deg: [],
    incidence_deg: [],
    u_px: [],
    v_px: [],
    x_mm: [],
    y_mm: [],
    z_mm: [],
    turn_deg: [],
    is_hidden: [],
  };
  for (const node of NODES) for (const axis of "xyz") of[`${node}_${axis}`] = [];
  ends.forEach((end, i) => {
    const at: Record<string, Vec3> = {
      lens: [0, 0, -100],
      second: [NaN, NaN, NaN],
      mirror: [0, 2 * i, 0],
      wall: [NaN, NaN, NaN],
      end,
    };
    for (const node of NODES)
      [..."xyz"].forEach((axis, k) => of[`${node}_${axis}`].push(at[node][k]));
    const read = {
      omega_deg: i === 2 ? NaN : 30 * i,
      incidence_deg: 10 + i,
      u_px: 5,
      v_px: 6,
      x_mm: -1e-9,
      y_mm: 2 * i,
      z_mm: 0.5,
      turn_deg: 90 * i,
      is_hidden: Number(i === 1),
    };
    for (const [name, value] of Object.entries(read)) of[name].push(value);
  });
  return columns("rays", of);
}

test("rays are read in words, and those that meet nothing are none", () => {
  const rays = raysOf(
    table([
      [0, 300, 0],
      [300, 0, 0],
      [0, 0, 300],
      [-300, 0, 0],
    ]),
  );
  expect(rays.map((ray) => ray.index)).toEqual([0, 1, 3]);
  expect(rays[0].nodes.length).toBe(3);
  expect(rays[0].nodes[rays[0].mirror]).toEqual([0, 0, 0]);
  expect(rays.map((ray) => ray.isForward)).toEqual([true, false, false]);
  expect(rays[1].words).toBe(
    "Field angle 30.0° · mirror point x 0, y 2.000, z 0.5000 mm · angle of incidence 11.00° · pixel 5.0, 6.0 · obstructed by the housing",
  );
});

test("a click means the ray that passes nearest on the screen, and none where none is near", () => {
  const rays = raysOf(
    table([
      [0, 300, 0],
      [300, 0, 0],
    ]),
  );
  const look = { ...ORBIT, target: [0, 0, 0] as Vec3, around: -0.4, above: 0.2 };
  const size = [800, 400] as const;
  const matrix = matrixOf(look, 2);
  const pixel = (place: Vec3): [number, number] => {
    const [x, y] = onScreen(look, place);
    return [(x + 1) * 400, (1 - y) * 200];
  };
  expect(nearest(rays, matrix, size, pixel([0, 40, 0]), 9)?.index).toBe(0);
  const [x, y] = pixel([40, 2, 0]);
  expect(nearest(rays, matrix, size, [x, y + 4], 9)?.index).toBe(1);
  expect(nearest(rays, matrix, size, [x, y + 30], 9)).toBeNull();
  const within = { ...look, distance: 50 }; // one end of the ray is behind the camera
  expect(nearest(rays, matrixOf(within, 2), size, [400, 200], 9)?.index).toBe(0);
});
