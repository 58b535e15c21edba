/** Camera of the page compared with values computed by Python (fixtures/make.py) and with simple formulas. */
import { describe, expect, test } from "vitest";
import { Camera } from "../src/look/geometry/camera";
import { between, given, vector } from "./tables";

/** Tolerance of the tables: those of the fixtures have 1/4 and 1/10 of the entries of the server. */
const NEAR_PX = { sphere: 0.01, ball: 0.002, decentred: 0.6 } as const;
const NEAR_RAD = { sphere: 3e-5, ball: 1e-5, decentred: 2e-3 } as const;
const NAMES = ["sphere", "ball", "decentred"] as const;

describe.each(NAMES)("%s", (name) => {
  const { camera, far, near, back } = given(name);

  test.each([
    ["directions", far, false],
    ["points", near, true],
  ] as const)("pixels of %s", (_, pairs, isPoint) => {
    let visible = 0;
    for (const [target, pixel] of pairs) {
      const result = camera.project(vector(target), isPoint);
      expect(result.visible, String(target)).toBe(pixel !== null);
      if (!pixel) continue;
      visible++;
      expect(
        Math.hypot(result.pixel[0] - pixel[0], result.pixel[1] - pixel[1]),
        String(target),
      ).toBeLessThan(NEAR_PX[name]);
    }
    expect(visible).toBeGreaterThan(15);
  });

  test("directions of pixels", () => {
    let visible = 0;
    for (const [pixel, direction] of back) {
      const result = camera.backproject([pixel[0], pixel[1]]);
      expect(result !== null, String(pixel)).toBe(direction !== null);
      if (!result || !direction) continue;
      visible++;
      expect(between(result, direction), String(pixel)).toBeLessThan(NEAR_RAD[name]);
    }
    expect(visible).toBeGreaterThan(10);
  });

  test("a pixel is seen at its own direction", () => {
    for (const [pixel, direction] of back) {
      const result = camera.backproject([pixel[0], pixel[1]]);
      if (!result || !direction) continue;
      const again = camera.project(result).pixel;
      expect(Math.hypot(again[0] - pixel[0], again[1] - pixel[1])).toBeLessThan(1e-4);
    }
  });
});

test("a ball seen from afar, by its formula: r = R sin(Omega/2) / sin(field/4)", () => {
  const { camera } = given("ball");
  const [field, radius] = [(300 * Math.PI) / 180, 500];
  const { axis, right } = camera.model;
  for (const omega of [0.1, 0.7, 1.5, 2.2, 2.6]) {
    const target = axis.map((a, i) => Math.cos(omega) * a + Math.sin(omega) * right[i]);
    const { pixel, visible } = camera.project(vector(target));
    expect(visible).toBe(true);
    expect(pixel[0] - 511.5).toBeCloseTo((radius * Math.sin(omega / 2)) / Math.sin(field / 4), 3);
    expect(pixel[1]).toBeCloseTo(511.5, 6);
  }
});

test("a circle that was moved takes every pixel with it", () => {
  const { camera, far } = given("sphere");
  const { u, v, radius } = camera.circle;
  const moved = camera.fitted({ u: 200, v: 150, radius: radius / 3 }, [420, 310]);
  expect(camera.isMoved).toBe(false);
  expect(moved.isMoved).toBe(true);
  for (const [target, pixel] of far) {
    if (!pixel) continue;
    const result = moved.project(vector(target)).pixel;
    expect(result[0]).toBeCloseTo(200 + (camera.project(vector(target)).pixel[0] - u) / 3, 9);
    expect(result[1]).toBeCloseTo(150 + (camera.project(vector(target)).pixel[1] - v) / 3, 9);
  }
});

test("what lies beyond the field, or beside the picture, is not seen", () => {
  const { camera } = given("sphere");
  const { axis } = camera.model;
  expect(camera.project(vector(axis)).visible).toBe(true);
  expect(camera.project(vector(axis.map((a) => -a))).visible).toBe(false);
  expect(camera.fitted(camera.circle, [300, 1024]).project(vector(axis)).visible).toBe(false);
  expect(camera.backproject([0, 0])).toBeNull();
});

test("a camera that is leaned here stands as one that Python leans", () => {
  const { tables } = given("sphere").camera;
  const { camera: tilted, far } = given("leaning");
  const { pitch_deg: pitch, roll_deg: roll } = tilted.model.mount;
  expect([pitch, roll]).toEqual([6, -4]);
  const leaned = new Camera(given("plumb").camera.model, tables).tilted({ pitch, roll });
  expect(leaned.model.mount).toEqual(tilted.model.mount);
  for (const key of ["axis", "right", "down"] as const)
    leaned.model[key].forEach((x, i) => expect(x).toBeCloseTo(tilted.model[key][i], 9));
  for (const [target, pixel] of far) {
    const result = leaned.project(vector(target));
    expect(result.visible).toBe(pixel !== null);
    if (pixel)
      expect(Math.hypot(result.pixel[0] - pixel[0], result.pixel[1] - pixel[1])).toBeLessThan(0.01);
  }
});
