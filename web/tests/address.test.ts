/** Links restore the state; invalid entries are ignored and reported. */
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
  const { state: again, error } = fromHash(toHash(state));
  expect(again).toEqual(limited(state));
  expect(error).toBeNull();
});

test("what is as at first is not in the address", () => {
  expect(toHash(INITIAL)).toBe("");
  expect(toHash({ ...INITIAL, pan: 12 })).toBe("#pan=12");
  expect(toHash({ ...INITIAL, design: "{}", tab: "look" })).toBe(""); // the design belongs to another tab
});

test("an address is the same with and without its #", () =>
  expect(read("#pan=5")).toEqual(read("pan=5")));

describe("what cannot be is left out, and said", () => {
  test.each([
    [
      "mode=cube",
      "mode must be one of panorama, perspective, dome, planet, ground, mosaic; got cube",
    ],
    ["hfov=200", "hfov must be between 2 and 160; got 200"],
    ["hfov=wide", "hfov must be between 2 and 160; got wide"],
    ["zoom=", "zoom must be between 1 and 20; got "],
    ["distance=-5", "distance must be between 100 and 1000000; got -5"],
    ["distance=NaN", "distance must be between 100 and 1000000; got NaN"],
    ["pan=Infinity", "pan must be a number; got Infinity"],
    ["height=1e9", "height must be between 10 and 100000; got 1e9"],
    ["flipped=yes", "flipped must be true or false; got yes"],
    ["rim=1,2", "rim must be u,v,radius in px; got 1,2"],
    ["rim=1,2,-3", "rim must be u,v,radius in px; got 1,2,-3"],
    ["looks=sideways", "looks must be one of up, down, forward; got sideways"],
    ["tab=bake", "tab must be one of look, design, calibrate; got bake"],
    ["roll=181", "roll must be between -180 and 180; got 181"],
  ])("%s", (hash, status) => {
    const { state, error } = fromHash(`#${hash}&tilt=7`);
    expect(state).toEqual({ ...INITIAL, tilt: 7 });
    expect(error).toBe(`Ignored invalid entries of the address: ${status}.`);
  });

  test("all of it at once", () =>
    expect(fromHash("#mode=cube&hfov=0").error).toMatch(
      /hfov must be .*; got 0; mode must be .*; got cube/,
    ));
  test("of something endless only the beginning", () =>
    expect(fromHash(`#mode=${"x".repeat(500)}`).error!.length).toBeLessThan(200));
  test("entries that no page ever had are nobody's trouble", () =>
    expect(fromHash("#utm=1&pan=3")).toEqual({ state: { ...INITIAL, pan: 3 }, error: null }));
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
