import { fixed, words } from "../shared/numbers";
import type { Columns } from "./host";
import type { Vec3 } from "../shared/vectors";
import { type Matrix, transformed } from "./vectors";

const NODES = ["lens", "second", "mirror", "wall", "end"] as const;
const HALF_TURN = 180;

/** Ray: its nodes and readings. */
export interface Ray {
  /** Index in the response. */
  index: number;
  nodes: Vec3[];
  /** Index of its mirror node. */
  mirror: number;
  omega: number;
  isHidden: boolean;
  /** Whether it is in the vertical plane of the forward direction. */
  isForward: boolean;
  words: string;
}

export function raysOf(table: Columns): Ray[] {
  const columns = NODES.map((node) =>
    ["x", "y", "z"].map((axis) => table.column(`${node}_${axis}`)),
  );
  const at = (name: string, i: number): number => table.column(name)[i];
  return Array.from({ length: table.rows }, (_, index): Ray => {
    const all = columns.map((c): Vec3 => [c[0][index], c[1][index], c[2][index]]);
    const met = all.map((p) => p.every(Number.isFinite));
    const isHidden = at("is_hidden", index) > 0;
    return {
      index,
      nodes: all.filter((_, i) => met[i]),
      mirror: met.slice(0, NODES.indexOf("mirror")).filter(Boolean).length,
      omega: at("omega_deg", index),
      isHidden,
      isForward: at("turn_deg", index) % HALF_TURN === 0,
      words: `Field angle ${fixed(at("omega_deg", index), 1)}° · mirror point ${["x", "y", "z"].map((axis) => `${axis} ${words(near0(at(`${axis}_mm`, index)), 4)}`).join(", ")} mm · angle of incidence ${fixed(at("incidence_deg", index), 2)}° · pixel ${fixed(at("u_px", index), 1)}, ${fixed(at("v_px", index), 1)}${isHidden ? " · obstructed by the housing" : ""}`,
    };
  }).filter((ray) => Number.isFinite(ray.omega) && ray.nodes.length > 1);
}

const near0 = (mm: number): number => (Math.abs(mm) < 1e-6 ? 0 : mm);

/** Return the ray closest to a screen position, within a maximum distance in px. */
export function nearest(
  rays: Ray[],
  matrix: Matrix,
  [width, height]: readonly [number, number],
  [x, y]: readonly [number, number],
  within: number,
): Ray | null {
  let [best, result]: [number, Ray | null] = [within, null];
  for (const ray of rays) {
    const places = ray.nodes.map((node) => transformed(matrix, node));
    for (let i = 0; i + 1 < places.length; i++) {
      const ends = inFront(places[i], places[i + 1]);
      if (!ends) continue;
      const [a, b] = ends.map(([u, v, , w]) => [
        (u / w + 1) * (width / 2),
        (1 - v / w) * (height / 2),
      ]);
      const distance = apart([x, y], a, b);
      if (distance < best) [best, result] = [distance, ray];
    }
  }
  return result;
}

type Place = [number, number, number, number];

/** Return the part of a line in front of the near plane. */
function inFront(a: Place, b: Place): [Place, Place] | null {
  const minimum = 1e-6 * (Math.abs(a[3]) + Math.abs(b[3]));
  if (a[3] < minimum && b[3] < minimum) return null;
  const cut = (from: Place, to: Place): Place => {
    const t = (minimum - from[3]) / (to[3] - from[3]);
    return from.map((c, i) => c + t * (to[i] - c)) as Place;
  };
  return [a[3] < minimum ? cut(a, b) : a, b[3] < minimum ? cut(b, a) : b];
}

/** Return the distance of a point from a line segment. */
function apart([x, y]: readonly number[], [ax, ay]: number[], [bx, by]: number[]): number {
  const [dx, dy] = [bx - ax, by - ay];
  const t = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1)));
  return Math.hypot(x - ax - t * dx, y - ay - t * dy);
}
