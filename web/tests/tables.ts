import type { CameraInfo } from "../src/shared/messages";
import { Camera } from "../src/look/geometry/camera";
import { floats } from "../src/look/embedded";
import type { Vec3 } from "../src/shared/vectors";
import made from "./fixtures/cameras.json";

type Pairs = [number[], number[] | null][];

/** Camera of the fixtures with values computed by Python: pixels of directions and points, directions of pixels. */
export interface Given {
  camera: Camera;
  far: Pairs;
  near: Pairs;
  back: Pairs;
}

export function given(name: keyof typeof made): Given {
  const { model, tables, far, near, back } = made[name] as unknown as {
    model: CameraInfo;
    tables: string;
  } & Omit<Given, "camera">;
  return { camera: new Camera(model, floats(tables)), far, near, back };
}

export const vector = (v: number[]): Vec3 => v as unknown as Vec3;

/** Angle between two vectors, radians. */
export function between(a: readonly number[], b: readonly number[]): number {
  const cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  return Math.atan2(Math.hypot(...cross), a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
}
