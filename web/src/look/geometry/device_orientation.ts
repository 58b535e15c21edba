import type { Vec3 } from "../../shared/vectors";
import { RAD } from "./vectors";

/** Orientation of a device relative to the earth, degrees, as reported by browsers: rotations about up, its right axis and its top axis. */
export interface Orientation {
  alpha: number;
  beta: number;
  gamma: number;
}

/** Return the direction of the back of a device: east, north, up. */
function backOf({ alpha, beta, gamma }: Orientation): Vec3 {
  const [[ca, sa], [cb, sb], [cg, sg]] = [alpha, beta, gamma].map((angle) => [
    Math.cos(angle * RAD),
    Math.sin(angle * RAD),
  ]);
  const [x, y] = [-sg, cg * sb];
  return [x * ca - y * sa, x * sa + y * ca, -cg * cb];
}

/** Return heading (clockwise from north) and elevation of the back of a device, degrees. */
export function aimOf(orientation: Orientation): { heading: number; tilt: number } {
  const [east, north, up] = backOf(orientation);
  return {
    heading: Math.atan2(east, north) / RAD,
    tilt: Math.atan2(up, Math.hypot(east, north)) / RAD,
  };
}
