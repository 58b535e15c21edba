import { RAD, type Vec3 } from "./vectors";

/** How a device is turned against the earth, degrees, as browsers tell it: about up, then its own right, then its top. */
export interface Orientation {
  alpha: number;
  beta: number;
  gamma: number;
}

/** Where the back of a device looks: east, north and up. */
function backOf({ alpha, beta, gamma }: Orientation): Vec3 {
  const [[ca, sa], [cb, sb], [cg, sg]] = [alpha, beta, gamma].map((angle) => [
    Math.cos(angle * RAD),
    Math.sin(angle * RAD),
  ]);
  const [x, y] = [-sg, cg * sb];
  return [x * ca - y * sa, x * sa + y * ca, -cg * cb];
}

/** Whither the back of a device looks, degrees: clockwise from north, and above the horizon. */
export function aimOf(orientation: Orientation): { heading: number; tilt: number } {
  const [east, north, up] = backOf(orientation);
  return {
    heading: Math.atan2(east, north) / RAD,
    tilt: Math.atan2(up, Math.hypot(east, north)) / RAD,
  };
}
