/** Links: what the address holds comes back, and what cannot be is left out and said. */
import { describe, expect, test } from "vitest";
import { fromHash, toHash } from "../src/shared/address";
import { differing, INITIAL, limited, type State } from "../src/shared/state";

const read = (hash: string): State => fromHash(hash).state;

const STATES: Partial<State>[] = [
  {},
  { mode: "perspective", pan: -123.4567, tilt: 33.25, hfov: 61.5 },
  { mode: "ground", height: 850, zoom: 2.5, pan: 180 - 1e-4 },
  { mode: "panorama", distance: 250, zoom: 1.75 },
  { source: "kept:0123456789abcdef:käse & brot #1 = 100%.png", rim: [511.25, 508.5, 470.125] },
  { source: "server:0/über uns.jpg", sensor: "file:abc" },
  { looks: "forward", forward: -90.5, flipped: false, pitch: 3.25, roll: -2.5 },
  { flipped: true, sensor: "ball:320" },
  {
    tab: "design",
    design: JSON.stringify({ tables: { mirror: { kind: "sphere" } }, requirements: null }),
  },
];

test.each(STATES)("%j comes back", (change) => {
  const state = { ...INITIAL, ...change };
  const { state: again, trouble } = fromHash(toHash(state));
  expect(again).toEqual(limited(state));
  expect(trouble).toBeNull();
});

test("what is as at first is not in the address", () => {
  expect(toHash(INITIAL)).toBe("");
  expect(toHash({ ...INITIAL, pan: 12 })).toBe("#pan=12");
  expect(toHash({ ...INITIAL, design: "{}", tab: "look" })).toBe(""); // the design is of the other tab
});

test("an address is the same with and without its #", () =>
  expect(read("#pan=5")).toEqual(read("pan=5")));

describe("what cannot be is left out, and said", () => {
  test.each([
    ["mode=cube", "mode = cube (valid are panorama, perspective, dome, planet, ground, mosaic)"],
    ["hfov=200", "hfov = 200 (valid from 2 to 160)"],
    ["hfov=wide", "hfov = wide (valid from 2 to 160)"],
    ["zoom=", "zoom =  (valid from 1 to 20)"],
    ["distance=-5", "distance = -5 (valid from 100 to 1000000)"],
    ["distance=NaN", "distance = NaN (valid from 100 to 1000000)"],
    ["pan=Infinity", "pan = Infinity (valid is a number)"],
    ["height=1e9", "height = 1e9 (valid from 10 to 100000)"],
    ["flipped=yes", "flipped = yes (valid are true, false)"],
    ["rim=1,2", "rim = 1,2 (valid are a centre and a radius, px: u,v,radius)"],
    ["rim=1,2,-3", "rim = 1,2,-3 (valid are a centre and a radius, px: u,v,radius)"],
    ["looks=sideways", "looks = sideways (valid are up, down, forward)"],
    ["tab=bake", "tab = bake (valid are look, design, calibrate)"],
    ["roll=181", "roll = 181 (valid from -180 to 180)"],
  ])("%s", (hash, said) => {
    const { state, trouble } = fromHash(`#${hash}&tilt=7`);
    expect(state).toEqual({ ...INITIAL, tilt: 7 });
    expect(trouble).toBe(`In the address, what cannot be was left out: ${said}.`);
  });

  test("all of it at once", () =>
    expect(fromHash("#mode=cube&hfov=0").trouble).toMatch(/hfov = 0 .*; mode = cube/));
  test("of something endless only the beginning", () =>
    expect(fromHash(`#mode=${"x".repeat(500)}`).trouble!.length).toBeLessThan(200));
  test("entries that no page ever had are nobody's trouble", () =>
    expect(fromHash("#utm=1&pan=3")).toEqual({ state: { ...INITIAL, pan: 3 }, trouble: null }));
});

test("angles go round, other numbers end at their ends, and none is finer than a command tells it", () => {
  expect(read("#pan=540").pan).toBe(-180);
  expect(read("#pan=-190").pan).toBe(170);
  expect(limited({ ...INITIAL, zoom: 99, tilt: -91, hfov: 1, height: 1 })).toMatchObject({
    zoom: 20,
    tilt: -90,
    hfov: 2,
    height: 10,
  });
  expect(limited({ ...INITIAL, pan: 1.23456789 }).pan).toBe(1.2346);
  expect(limited({ ...INITIAL, distance: Infinity }).distance).toBe(Infinity);
  expect(read("#distance=Infinity").distance).toBe(Infinity);
});

test("states differ where a value does", () => {
  expect(differing(INITIAL, { ...INITIAL })).toEqual(new Set());
  expect(differing(INITIAL, { ...INITIAL, rim: [1, 2, 3], pan: 1 })).toEqual(
    new Set(["rim", "pan"]),
  );
  expect(differing({ ...INITIAL, rim: [1, 2, 3] }, { ...INITIAL, rim: [1, 2, 3] })).toEqual(
    new Set(),
  );
});
