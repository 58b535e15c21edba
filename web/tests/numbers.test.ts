/** Numbers, units and names as displayed, and slider scales. */
import { expect, test } from "vitest";
import { label, unitWords } from "../src/design/labels";
import { scaleOf } from "../src/design/panels/slider_scale";
import { clamp, fixed, words, wrapped } from "../src/shared/numbers";
import type { ParameterInfo } from "../src/shared/messages";

test.each<[number | null | undefined, number, string]>([
  [Math.PI, 4, "3.142"],
  [1234.567, 4, "1235"],
  [-0.0012345, 3, "−0.00123"],
  [0, 4, "0"],
  [1e-12, 4, "0"],
  [2.5e-5, 3, "2.50e−5"],
  [1.5e6, 3, "1.50e+6"],
  [Infinity, 4, "∞"],
  [-Infinity, 4, "−∞"],
  [NaN, 4, "–"],
  [null, 4, "–"],
  [undefined, 4, "–"],
])("%s in %i digits is %s", (value, digits, text) => expect(words(value, digits)).toBe(text));

test("so many decimals", () =>
  expect([fixed(-1.005, 2), fixed(2, 3), fixed(NaN, 1)]).toEqual(["−1.00", "2.000", "–"]));

test("angles go round", () =>
  expect([0, 180, -180, 190, 540, -730].map(wrapped)).toEqual([0, -180, -180, -170, -180, -10]));

test("a clamp holds both ends", () =>
  expect([-1, 5, 12].map((x) => clamp(x, 0, 10))).toEqual([0, 5, 10]));

test.each([
  ["rim_radius_mm", "Rim radius"],
  ["pixel_pitch_um", "Pixel pitch"],
  ["omega_max_deg", "Ω max"],
  ["theta_max_deg", "Θ max"],
  ["f_number", "F-number"],
  ["working_f_number", "Working F-number"],
  ["k1", "K1"],
])("%s is called %s", (name, text) => expect(label(name)).toBe(text));

test("units are written as people write them", () =>
  expect(["deg", "um", "deg2", "px/deg", "mm"].map(unitWords)).toEqual([
    "°",
    "µm",
    "deg²",
    "px/°",
    "mm",
  ]));

const parameter = (
  low: number,
  high: number,
  more: Partial<ParameterInfo> = {},
): ParameterInfo => ({
  name: "x",
  unit: "",
  low,
  high,
  description: "",
  choices: [],
  is_list: false,
  is_integer: false,
  is_optional: false,
  default: null,
  ...more,
});

test.each([
  ["a short range is shown whole", parameter(0, 180), 40, 0, 180],
  ["positive values have a decade with round ends", parameter(1e-3, 1e7), 49.96, 10, 100],
  ["values near the lower end of a decade have another one", parameter(1e-3, 1e7), 33, 10, 100],
  ["the decade ends at the permitted range", parameter(50, 1e7), 100, 50, 300],
  ["an interval around 0 has round ends", parameter(-1e6, 1e6), -300, -1000, 1000],
  ["0 has a small interval", parameter(-1e6, 1e6), 0, -0.1, 0.1],
])("%s", (_, p, value, low, high) => {
  const scale = scaleOf(p, value);
  expect(scale.low).toBeCloseTo(low, 9);
  expect(scale.high).toBeCloseTo(high, 9);
  for (const place of [0, 0.1, 0.5, 0.99, 1])
    expect(scale.from(scale.to(place))).toBeCloseTo(place, 2);
  expect(Math.abs(scale.to(scale.from(value)) - value)).toBeLessThan(1e-2 * (high - low));
  expect([scale.from(-1e9), scale.from(1e9)]).toEqual([expect.closeTo(0, 6), 1]);
});

test("the handle displays the position of the value between the ends", () => {
  const p = parameter(1e-3, 1e7);
  expect(scaleOf(p, 49.96).from(49.96)).toBeCloseTo(0.7, 2);
  expect(scaleOf(p, 12).from(12)).toBeCloseTo(0.6, 2);
  for (const value of [0.0012, 1, 1.3, 2.9, 3, 3.8, 9.99, 1e6]) {
    const place = scaleOf(p, value).from(value);
    expect(place).toBeGreaterThan(0.05);
    expect(place).toBeLessThan(0.95);
  }
});

test("the ends do not swap for values outside the permitted range", () => {
  for (const value of [-5, 0, 1e9]) {
    const scale = scaleOf(parameter(1e-3, 1e7), value);
    expect(scale.low).toBeLessThan(scale.high);
    expect(scale.low).toBeGreaterThanOrEqual(1e-3);
    expect(scale.high).toBeLessThanOrEqual(1e7);
  }
});

test("whole numbers stay whole", () => {
  expect(scaleOf(parameter(1, 1e5, { is_integer: true }), 1000).to(0.37)).toSatisfy(
    Number.isInteger,
  );
});
