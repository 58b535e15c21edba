/** Logarithmic axis of the tolerance bars. */
import { expect, test } from "vitest";
import { logAxis } from "../src/design/tolerances/log_axis";

test("ticks are whole decades around the values", () => {
  const { ticks, place } = logAxis([0.02, 0.3, 4]);
  expect(ticks).toEqual([0.01, 0.1, 1, 10]);
  expect(place(0.01)).toBe(0);
  expect(place(1)).toBeCloseTo(2 / 3, 12);
  expect(place(10)).toBe(1);
});

test("at most five decades are displayed, and small values are at the start", () => {
  const { ticks, place } = logAxis([1e-12, 100]);
  expect(ticks).toEqual([0.001, 0.01, 0.1, 1, 10, 100]);
  expect([place(1e-12), place(0)]).toEqual([0, 0]);
});

test("axes of equal or missing values have one decade", () => {
  expect(logAxis([1]).ticks).toEqual([0.1, 1]);
  expect(logAxis([]).ticks).toEqual([0.1, 1]);
  expect(logAxis([0, Infinity]).place(0.5)).toBeGreaterThan(0);
});
