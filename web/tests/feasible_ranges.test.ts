import { expect, test } from "vitest";
import { feasibleSpans, placesWith } from "../src/design/panels/feasible_ranges";

const EVEN = placesWith(0);

test("where a slider stands is looked at too", () => {
  expect(EVEN).toEqual([0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1]);
  expect(placesWith(0.3)).toHaveLength(10);
  expect(placesWith(0.5)).toEqual(EVEN);
});

test("a straight line is met up to where it is 0", () => {
  const [[from, to]] = feasibleSpans(
    EVEN,
    EVEN.map((x) => [x - 0.4, -1e-6]),
  );
  expect(from).toBe(0);
  expect(to).toBeCloseTo(0.4, 12);
});

test("what is met in two parts has two", () => {
  const spans = feasibleSpans(
    EVEN,
    EVEN.map((x) => [0.3 - Math.abs(x - 0.5)]),
  );
  expect(spans.flat().map((x) => Number(x.toFixed(12)))).toEqual([0, 0.2, 0.8, 1]);
});

test("next to a design that cannot be it is met half way, and nowhere is nowhere", () => {
  expect(
    feasibleSpans(
      EVEN,
      EVEN.map((x) => (x < 0.5 ? null : [-1])),
    ),
  ).toEqual([[0.4375, 1]]);
  expect(
    feasibleSpans(
      EVEN,
      EVEN.map(() => [1]),
    ),
  ).toEqual([]);
  expect(
    feasibleSpans(
      EVEN,
      EVEN.map(() => null),
    ),
  ).toEqual([]);
});

test("each requirement has its own end", () => {
  const [[from, to], ...more] = feasibleSpans(
    EVEN,
    EVEN.map((x) => [0.3 - x, x - 0.8]),
  );
  expect([from, to].map((x) => Number(x.toFixed(12)))).toEqual([0.3, 0.8]);
  expect(more).toEqual([]);
});
