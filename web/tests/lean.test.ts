/** Tilt and levelling compared with simple rotations. */
import { expect, test } from "vitest";
import { raised, releaned, type Lean } from "../src/look/geometry/lean";
import { RAD, type Vec3 } from "../src/look/geometry/vectors";

const PLUMB: Lean = { pitch: 0, roll: 0 };
const [FORWARD, LEFT, UP]: Vec3[] = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

function expectNear(found: Vec3, wanted: Vec3): void {
  wanted.forEach((x, i) => expect(found[i]).toBeCloseTo(x, 12));
}

test("a sensor that pitches looks up, and its left stays level", () => {
  const to: Lean = { pitch: 10, roll: 0 };
  const [c, s] = [Math.cos(10 * RAD), Math.sin(10 * RAD)];
  expectNear(releaned(FORWARD, PLUMB, to), [c, 0, s]);
  expectNear(releaned(LEFT, PLUMB, to), LEFT);
  expectNear(releaned(UP, PLUMB, to), [-s, 0, c]);
});

test("a sensor that rolls clockwise, as seen from behind, has its left up and its forward where it was", () => {
  const to: Lean = { pitch: 0, roll: 10 };
  const [c, s] = [Math.cos(10 * RAD), Math.sin(10 * RAD)];
  expectNear(releaned(FORWARD, PLUMB, to), FORWARD);
  expectNear(releaned(LEFT, PLUMB, to), [0, c, s]);
  expectNear(releaned(UP, PLUMB, to), [0, -s, c]);
});

test("leaning back is no lean at all", () => {
  const lean: Lean = { pitch: -35, roll: 62 };
  const v: Vec3 = [0.3, -0.8, 0.5];
  expectNear(releaned(releaned(v, PLUMB, lean), lean, PLUMB), v);
  expectNear(releaned(v, lean, lean), v);
});

test("lifting what is straight ahead pitches, what is to the right rolls, what is behind pitches down", () => {
  const near = (found: Lean, wanted: Lean): void => {
    expect(found.pitch).toBeCloseTo(wanted.pitch, 10);
    expect(found.roll).toBeCloseTo(wanted.roll, 10);
  };
  near(raised(PLUMB, 0, 4), { pitch: 4, roll: 0 });
  near(raised(PLUMB, 90, 4), { pitch: 0, roll: -4 });
  near(raised(PLUMB, 180, 4), { pitch: -4, roll: 0 });
});

test("a horizon that was dragged level in two places is level everywhere", () => {
  // A tilted sensor whose file has no tilt: points of the horizon appear where an untilted sensor images them.
  const truth: Lean = { pitch: 7, roll: -5 };
  let lean: Lean = PLUMB;
  const tiltAt = (pan: number): { pan: number; tilt: number } => {
    // Direction of the horizon as displayed with an assumed tilt.
    const seen = releaned([Math.cos(pan * RAD), -Math.sin(pan * RAD), 0], truth, lean);
    return { pan: Math.atan2(-seen[1], seen[0]) / RAD, tilt: Math.asin(seen[2]) / RAD };
  };
  for (let i = 0; i < 8; i++)
    for (const pan of [0, 90]) {
      const shown = tiltAt(pan);
      lean = raised(lean, shown.pan, -shown.tilt);
    }
  expect(lean.pitch).toBeCloseTo(truth.pitch, 4);
  expect(lean.roll).toBeCloseTo(truth.roll, 4);
  for (const pan of [30, 135, -100]) expect(tiltAt(pan).tilt).toBeCloseTo(0, 4);
});
