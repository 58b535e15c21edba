/** Targets of view pixels compared with Python (fixtures/make.py). */
import { describe, expect, test } from "vitest";
import { aspectOf, pixelIn, positionOf, targetIn, viewOf } from "../src/look/geometry/views";
import { INITIAL, type State } from "../src/shared/state";
import views from "./fixtures/views.json";
import { between, given } from "./tables";

const NEAR_RAD = 5e-6; // angles of commands have four decimals
const NEAR_MM = 0.02;
const { camera } = given("sphere");

describe.each(views.map((view) => [JSON.stringify(view.state), view] as const))(
  "%s",
  (_, { state, request, size, parts }) => {
    const view = viewOf(
      { ...INITIAL, ...(state as Partial<State>) },
      camera,
      request[0],
      request[1],
    );

    test("is as large", () => expect([view.width, view.height]).toEqual(size));

    test("has its parts where they belong", () =>
      expect(view.parts.map((p) => p.isPoint)).toEqual(parts.map((p) => p.near)));

    test("looks at the same", () => {
      for (const { near, looks } of parts)
        for (const [[u, v], requested] of looks as [number[], number[] | null][]) {
          const target = targetIn(view, u, v);
          expect(target !== null, `${u}, ${v}`).toBe(requested !== null);
          if (!target || !requested) continue;
          expect(between(target, requested), `${u}, ${v}`).toBeLessThan(NEAR_RAD);
          if (near)
            expect(
              Math.abs(Math.hypot(...target) - Math.hypot(...requested)),
              `${u}, ${v}`,
            ).toBeLessThan(NEAR_MM);
        }
    });
  },
);

test("a panorama is as wide as it takes, a dome round, a perspective as one likes", () => {
  const aspects = (["panorama", "dome", "planet", "ground", "perspective"] as const).map((mode) =>
    aspectOf({ ...INITIAL, mode }, camera),
  );
  expect(aspects[0]).toBeCloseTo(360 / 135, 3); // the field is -90 to 45 degrees
  expect(aspects.slice(1)).toEqual([1, 1, 1, null]);
});

test("a mosaic asks for the shape that it gets", () => {
  const s: State = { ...INITIAL, mode: "mosaic" };
  const { width, height } = viewOf(s, camera, 4000, 1);
  expect(width / height).toBeCloseTo(aspectOf(s, camera)!, 2);
});

test("nothing lies beside a view", () => {
  const view = viewOf({ ...INITIAL, mode: "perspective" }, camera, 100, 50);
  expect(targetIn(view, 99, 49)).not.toBeNull();
  expect(targetIn(view, 100, 20)).toBeNull();
  expect(targetIn(view, 20, -1)).toBeNull();
});

describe.each(["sphere", "ball", "decentred"] as const)("image pixels of %s", (name) => {
  const { camera } = given(name);
  const modes = ["panorama", "perspective", "dome", "planet", "ground", "mosaic"] as const;

  test.each(modes.flatMap((mode) => [Infinity, 700].map((distance) => [mode, distance] as const)))(
    "are displayed where they are picked: %s, %d mm",
    (mode, distance) => {
      const state = { ...INITIAL, mode, distance, pan: 30, tilt: -20, hfov: 70 };
      const view = viewOf(state, camera, 300, 200);
      let count = 0;
      for (let u = 5; u < view.width; u += 29)
        for (let v = 5; v < view.height; v += 23) {
          const pixel = pixelIn(view, camera, u, v);
          const isInside = [-4, 4].every(
            (d) => pixelIn(view, camera, u + d, v) && pixelIn(view, camera, u, v + d),
          );
          if (!pixel || !isInside) continue;
          const result = positionOf(view, camera, pixel);
          // a mosaic displays objects twice
          const again = result && pixelIn(view, camera, ...result);
          expect(again, `${u}, ${v}`).not.toBeNull();
          expect(Math.hypot(again![0] - pixel[0], again![1] - pixel[1])).toBeLessThan(0.05);
          if (mode === "mosaic") continue;
          expect(Math.hypot(result![0] - u, result![1] - v), `${u}, ${v}`).toBeLessThan(0.5);
          count++;
        }
      if (mode !== "mosaic") expect(count).toBeGreaterThan(10);
    },
  );
});
