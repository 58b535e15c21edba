import { clamp } from "../../shared/numbers";
import { cross, dot, type Vec3 } from "../../shared/vectors";
import { RAD, sum, times, viewAxes } from "./vectors";

/** Tilt of a sensor, degrees: pitch of the forward axis above the horizon, and clockwise roll about it. */
export interface Tilt {
  pitch: number;
  roll: number;
}

/** Forward, left and up axes of a tilted frame in world coordinates. */
type Axes = readonly [Vec3, Vec3, Vec3];

function axesOf({ pitch, roll }: Tilt): Axes {
  const [forward, right, down] = viewAxes(0, pitch);
  const [c, s] = [Math.cos(roll * RAD), Math.sin(roll * RAD)];
  return [forward, sum(times(-c, right), times(-s, down)), sum(times(s, right), times(-c, down))];
}

/** Rotate a vector that is attached to a sensor from one tilt to another. */
export function retilted(v: Vec3, from: Tilt, to: Tilt): Vec3 {
  const [a, b] = [axesOf(from), axesOf(to)];
  return sum(...b.map((axis, i) => times(dot(v, a[i]), axis)));
}

/** Return the tilt after raising a horizon direction by an angle, degrees. */
export function raised(tilt: Tilt, panDeg: number, upDeg: number): Tilt {
  const [, right] = viewAxes(panDeg, 0);
  const [forward, left, up] = axesOf(tilt).map((axis) => turned(axis, right, upDeg * RAD));
  return {
    pitch: Math.asin(clamp(forward[2], -1, 1)) / RAD,
    roll: Math.atan2(left[2], up[2]) / RAD,
  };
}

/** Rotate a vector about a unit vector, radians. */
export function turned(v: Vec3, about: Vec3, angle: number): Vec3 {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return sum(times(c, v), times(s, cross(about, v)), times((1 - c) * dot(about, v), about));
}
