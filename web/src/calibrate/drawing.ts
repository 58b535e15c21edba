/** Shapes drawn in images and plots: SVG paths in image pixels. */
import type { CoverageInfo } from "../shared/messages";

type Pair = readonly [number, number];

const at = (u: number, v: number): string => `${+u.toFixed(2)} ${+v.toFixed(2)}`;

/** Return the path of a cross at each corner. */
export const crosses = (corners: readonly Pair[], size: number): string =>
  corners
    .map(
      ([u, v]) =>
        `M${at(u - size, v)}h${+(2 * size).toFixed(2)}M${at(u, v - size)}v${+(2 * size).toFixed(2)}`,
    )
    .join("");

/** Return the path of a dot at each position, as a stroke without length. */
export const dots = (places: readonly Pair[]): string =>
  places.map(([x, y]) => `M${at(x, y)}h0`).join("");

/** Magnified residuals (u, v, du, dv) as lines from their corners. */
export const arrows = (
  residuals: readonly (readonly [number, number, number, number])[],
  times: number,
): string =>
  residuals.map(([u, v, du, dv]) => `M${at(u, v)}L${at(u + times * du, v + times * dv)}`).join("");

/** Return radial and tangential residuals: (radius, radial, tangential), px. */
export function byRadius(
  residuals: readonly (readonly [number, number, number, number])[],
  [cu, cv]: Pair,
): [number, number, number][] {
  return residuals.map(([u, v, du, dv]) => {
    const [x, y] = [u - cu, v - cv];
    const radius = Math.hypot(x, y);
    const [ex, ey] = radius > 0 ? [x / radius, y / radius] : [1, 0];
    return [radius, du * ex + dv * ey, dv * ex - du * ey];
  });
}

/** Cell of the field between two radii, centred on a direction. */
interface Cell {
  ring: number;
  sector: number;
  count: number;
  path: string;
}

/** Return the cells of the corner counts; sectors are numbered clockwise from the right. */
export function cellsOf({ centre_px: [u, v], radii_px: radii, counts }: CoverageInfo): Cell[] {
  const half = Math.PI / counts[0].length;
  const place = (radius: number, angle: number): string =>
    at(u + radius * Math.cos(angle), v + radius * Math.sin(angle));
  return counts.flatMap((row, ring) =>
    row.map((count, sector) => {
      const [from, to] = [2 * half * sector - half, 2 * half * sector + half];
      const [inner, outer] = [radii[ring], radii[ring + 1]];
      const back =
        inner > 0
          ? `L${place(inner, to)}A${inner} ${inner} 0 0 0 ${place(inner, from)}`
          : `L${at(u, v)}`;
      return {
        ring,
        sector,
        count,
        path: `M${place(inner, from)}L${place(outer, from)}A${outer} ${outer} 0 0 1 ${place(outer, to)}${back}Z`,
      };
    }),
  );
}

/** Return the number of covered cells, and the total number. */
export function coveredIn({ counts, min_corners }: CoverageInfo): [number, number] {
  const all = counts.flat();
  return [all.filter((count) => count >= min_corners).length, all.length];
}

/** Round magnification at which residuals of a given size have a given length in px. */
export function timesFor(rms: number, length: number): number {
  if (!(rms > 0)) return 1;
  const target = length / rms;
  const power = 10 ** Math.floor(Math.log10(target));
  return Math.max(1, power * ([5, 2, 1].find((m) => m * power <= target) ?? 1));
}

/** Return the displacement of a target between two detections, relative to the longer image side; Infinity for different corners. */
export function movedBy(
  before: { ids: number[]; corners_px: Pair[] } | null,
  now: { ids: number[]; corners_px: Pair[]; image_size: Pair },
): number {
  if (!before) return Infinity;
  const places = new Map(before.ids.map((id, i) => [id, before.corners_px[i]]));
  const steps = now.ids.flatMap((id, i) => {
    const was = places.get(id);
    return was ? [Math.hypot(now.corners_px[i][0] - was[0], now.corners_px[i][1] - was[1])] : [];
  });
  if (steps.length < now.ids.length / 2 || !steps.length) return Infinity;
  return steps.sort((a, b) => a - b)[Math.floor(steps.length / 2)] / Math.max(...now.image_size);
}
