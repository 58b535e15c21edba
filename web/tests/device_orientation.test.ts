/** Direction of the back of a phone in simple poses. */
import { expect, test } from "vitest";
import { aimOf } from "../src/look/geometry/device_orientation";

const POSES: [
  words: string,
  alpha: number,
  beta: number,
  gamma: number,
  heading: number,
  tilt: number,
][] = [
  ["upright, to the north", 0, 90, 0, 0, 0],
  ["upright, turned to the left", 90, 90, 0, -90, 0],
  ["leaned back, to the sky", 0, 120, 0, 0, 30],
  ["leaned forward, to the ground", 0, 50, 0, 0, -40],
  ["lying across, its left side up", 0, 0, -90, 90, 0],
  ["lying across, its right side up", 0, 0, 90, -90, 0],
  ["across and turned to the right", 300, 0, 90, -30, 0],
];

test.each(POSES)("%s", (_, alpha, beta, gamma, heading, tilt) => {
  const aim = aimOf({ alpha, beta, gamma });
  expect(Math.cos(((aim.heading - heading) * Math.PI) / 180)).toBeCloseTo(1, 10);
  expect(aim.tilt).toBeCloseTo(tilt, 8);
});

test("flat on a table it looks straight down, whatever way it lies", () => {
  for (const alpha of [0, 77, 200])
    expect(aimOf({ alpha, beta: 0, gamma: 0 }).tilt).toBeCloseTo(-90, 8);
});
