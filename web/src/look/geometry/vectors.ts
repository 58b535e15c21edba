import { cross, type Vec3 } from "../../shared/vectors";

export type Pixel = readonly [number, number];

export const RAD = Math.PI / 180;

export const times = (k: number, a: Vec3): Vec3 => [k * a[0], k * a[1], k * a[2]];
export const sum = (...vs: Vec3[]): Vec3 =>
  vs.reduce((a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);

/** Return the direction of pan (right positive) and tilt (up positive), radians. */
export function panTiltDirection(pan: number, tilt: number): Vec3 {
  const c = Math.cos(tilt);
  return [c * Math.cos(pan), -c * Math.sin(pan), Math.sin(tilt)];
}

/** Pan and tilt, degrees, of a direction. */
export function panTiltOf(d: Vec3): { pan: number; tilt: number } {
  return {
    pan: Math.atan2(-d[1], d[0]) / RAD,
    tilt: Math.atan2(d[2], Math.hypot(d[0], d[1])) / RAD,
  };
}

/** Return the forward, right and down axes of a view with pan and tilt, degrees. */
export function viewAxes(panDeg: number, tiltDeg: number): [Vec3, Vec3, Vec3] {
  const [a, t] = [panDeg * RAD, tiltDeg * RAD];
  const forward = panTiltDirection(a, t);
  const right: Vec3 = [-Math.sin(a), -Math.cos(a), 0];
  return [forward, right, cross(forward, right)];
}
