/** Tilt and levelling compared with simple rotations. */
import { expect, test } from "vitest";
import { raised, retilted, type Tilt } from "../src/look/geometry/tilt";
import type { Vec3 } from "../src/shared/vectors";
import { RAD } from "../src/look/geometry/vectors";

const PLUMB: Tilt = { pitch: 0, roll: 0 };
const [FORWARD, LEFT, UP]: Vec3[] = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

function expectNear(result: Vec3, requested: Vec3): void {
  requested.forEach((x, i) => expect(result[i]).toBeCloseTo(x, 12));
}

test("a sensor that pitches looks up, and its left stays level", () => {
  const to: Tilt = { pitch: 10, roll: 0 };
  const [c, s] = [Math.cos(10 * RAD), Math.sin(10 * RAD)];
  expectNear(retilted(FORWARD, PLUMB, to), [c, 0, s]);
  expectNear(retilted(LEFT, PLUMB, to), LEFT);
  expectNear(retilted(UP, PLUMB, to), [-s, 0, c]);
});

test("a sensor that rolls clockwise, as seen from behind, has its left up and its forward where it was", () => {
  const to: Tilt = { pitch: 0, roll: 10 };
  const [c, s] = [Math.cos(10 * RAD), Math.sin(10 * RAD)];
  expectNear(retilted(FORWARD, PLUMB, to), FORWARD);
  expectNear(retilted(LEFT, PLUMB, to), [0, c, s]);
  expectNear(retilted(UP, PLUMB, to), [0, -s, c]);
});

test("leaning back is no lean at all", () => {
  const tilt: Tilt = { pitch: -35, roll: 62 };
  const v: Vec3 = [0.3, -0.8, 0.5];
  expectNear(retilted(retilted(v, PLUMB, tilt), tilt, PLUMB), v);
  expectNear(retilted(v, tilt, tilt), v);
});

test("lifting what is straight ahead pitches, what is to the right rolls, what is behind pitches down", () => {
  const near = (result: Tilt, requested: Tilt): void => {
    expect(result.pitch).toBeCloseTo(requested.pitch, 10);
    expect(result.roll).toBeCloseTo(requested.roll, 10);
  };
  near(raised(PLUMB, 0, 4), { pitch: 4, roll: 0 });
  near(raised(PLUMB, 90, 4), { pitch: 0, roll: -4 });
  near(raised(PLUMB, 180, 4), { pitch: -4, roll: 0 });
});

test("a horizon that was dragged level in two places is level everywhere", () => {
  // A tilted sensor whose file has no tilt: points of the horizon appear where an untilted sensor images them.
  const truth: Tilt = { pitch: 7, roll: -5 };
  let tilt: Tilt = PLUMB;
  const tiltAt = (pan: number): { pan: number; tilt: number } => {
    // Direction of the horizon as displayed with an assumed tilt.
    const visible = retilted([Math.cos(pan * RAD), -Math.sin(pan * RAD), 0], truth, tilt);
    return { pan: Math.atan2(-visible[1], visible[0]) / RAD, tilt: Math.asin(visible[2]) / RAD };
  };
  for (let i = 0; i < 8; i++)
    for (const pan of [0, 90]) {
      const shown = tiltAt(pan);
      tilt = raised(tilt, shown.pan, -shown.tilt);
    }
  expect(tilt.pitch).toBeCloseTo(truth.pitch, 4);
  expect(tilt.roll).toBeCloseTo(truth.roll, 4);
  for (const pan of [30, 135, -100]) expect(tiltAt(pan).tilt).toBeCloseTo(0, 4);
});
