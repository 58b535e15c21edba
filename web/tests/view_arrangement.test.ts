/** Several views on one stage: no overlap, within the stage, with their aspect ratios; and their encoding. */
import { describe, expect, test } from "vitest";
import { arranged } from "../src/look/geometry/view_arrangement";
import { INITIAL, sourceOfState, ofView, textOf, viewsIn } from "../src/shared/state";

const STAGES = [
  [972, 500],
  [390, 515],
  [2000, 1200],
  [300, 900],
] as const;
const SETS: (number | null)[][] = [
  [null],
  [8 / 3, null],
  [8 / 3, null, null, null],
  [1, 1, 1],
  [8 / 3, 8 / 3],
  [null, 8 / 3, 1, null, 2.4],
  Array.from({ length: 16 }, () => null),
];

describe.each(STAGES)("a stage of %i x %i", (width, height) => {
  test.each(SETS.map((set) => [set]))("holds %j", (set) => {
    const cells = arranged(set, width, height);
    expect(cells.length).toBe(set.length);
    cells.forEach((a, i) => {
      expect(
        Math.min(a.left, a.top, width - a.left - a.width, height - a.top - a.height),
      ).toBeGreaterThan(-1e-6);
      expect(Math.min(a.width, a.height)).toBeGreaterThan(20);
      if (set[i] !== null) expect(a.width / a.height).toBeCloseTo(set[i], 6);
      for (const b of cells.slice(0, i)) {
        const over = [
          Math.min(a.left + a.width, b.left + b.width) - Math.max(a.left, b.left),
          Math.min(a.top + a.height, b.top + b.height) - Math.max(a.top, b.top),
        ];
        expect(Math.min(...over)).toBeLessThan(1e-6);
      }
    });
  });
});

test("views that any shape will do fill the stage", () => {
  const cells = arranged([null, null, null, null], 800, 500);
  expect(cells.reduce((sum, c) => sum + c.width * c.height, 0) / (800 * 500)).toBeGreaterThan(0.97);
});

test.each([
  [972, 470, 480],
  [2254, 1300, 1120],
])("four panoramas stand two by two on %i x %i", (width, height, minimum) => {
  const cells = arranged(
    Array.from({ length: 4 }, () => 8 / 3),
    width,
    height,
  );
  expect(Math.min(...cells.map((c) => c.width))).toBeGreaterThan(minimum);
});

describe("kept views", () => {
  const door = {
    name: "Door",
    ...ofView({ ...INITIAL, mode: "perspective", pan: 40, fit: "fill", distance: 850 }),
  };
  const all = { name: "Panorama", ...ofView(INITIAL) };
  const yard = {
    name: "Yard",
    ...ofView(INITIAL),
    of: sourceOfState({ ...INITIAL, source: "server:yard", rim: [10, 20.5, 9], pitch: -3 }),
  };
  const of = (change: object): string =>
    JSON.stringify([{ name: "a", of: { source: "server:a", sensor: "b", ...change } }]);

  test("come back", () => expect(viewsIn(textOf([all, door, yard]))).toEqual([all, door, yard]));
  test.each([
    { sensor: "" },
    { source: null },
    { rim: [1, 2] },
    { rim: [1, 2, -3] },
    { looks: "left" },
    { flipped: 1 },
    { pitch: "5" },
  ])("of %j are none", (change) =>
    expect([viewsIn(of({})), viewsIn(of(change))]).toEqual([expect.anything(), null]),
  );
  test("of none there is no text", () => expect([textOf([]), viewsIn("")]).toEqual(["", []]));
  test("say no more than they must", () => expect(textOf([all])).toBe('[{"name":"Panorama"}]'));
  test("are kept within what is valid", () =>
    expect(viewsIn('[{"name":"a","hfov":500,"pan":370}]')![0]).toMatchObject({
      hfov: 160,
      pan: 10,
    }));
  test.each([
    "{",
    "{}",
    "[1]",
    '[{"mode":"dome"}]',
    '[{"name":"a","mode":"cube"}]',
    '[{"name":"a","pan":"x"}]',
    '[{"name":"a","pan":null}]',
    '[{"name":"a","fit":"wide"}]',
    JSON.stringify(Array(17).fill(all)),
  ])("%s are none", (text) => expect(viewsIn(text)).toBeNull());
});
