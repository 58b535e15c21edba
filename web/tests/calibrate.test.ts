/** Computations of the tab Calibrate, compared with simple formulas. */
import { describe, expect, test } from "vitest";
import {
  arrows,
  byRadius,
  cellsOf,
  coveredIn,
  crosses,
  dots,
  movedBy,
  timesFor,
} from "../src/calibrate/drawing";
import {
  calibrateCommand,
  modelsFor,
  modelWords,
  printCommand,
  px,
  rimOf,
  stateWords,
  unlike,
  whyNot,
} from "../src/calibrate/formatting";
import { pack, unpack } from "../src/shared/binary_messages";
import type {
  BoardSpec,
  BoardDetection,
  CoverageInfo,
  DetectedOutline,
} from "../src/shared/messages";

const BOARD: BoardSpec = {
  kind: "chessboard",
  columns: 11,
  rows: 7,
  square_mm: 30,
  marker_mm: null,
  spacing: 0.3,
  family: null,
  legacy: false,
};
const SOUGHT = {
  board: BOARD,
  model: "auto",
  optics: "mirror",
  camera_looks: "up",
  image_flipped: false,
  centre_px: null,
  rim_radius_px: null,
  flat_board: false,
} as const;

describe("the command that does the same", () => {
  test("says what is not as usual, and nothing else", () => {
    expect(calibrateCommand(["a.jpg", "b c.jpg", "-x.png"], SOUGHT)).toBe(
      "omnimirror calibrate a.jpg 'b c.jpg' ./-x.png --board 11x7 --square-mm 30 -o camera.toml --report calibration.html",
    );
    const other = {
      ...SOUGHT,
      model: "unified",
      optics: "fisheye",
      camera_looks: "forward",
      image_flipped: true,
      centre_px: [324.5, 246] as [number, number],
      rim_radius_px: 223.5,
      flat_board: true,
    } as const;
    expect(calibrateCommand(["a.jpg"], other)).toBe(
      "omnimirror calibrate a.jpg --board 11x7 --square-mm 30 --model unified --set camera.optics=fisheye --camera-looks forward --set camera.image_flipped=true --set camera.centre_px=324.5,246 --set camera.rim_radius_px=223.5 --set estimation.board_shape=false -o camera.toml --report calibration.html",
    );
  });
  test("names a folder in the place of very many files", () =>
    expect(
      calibrateCommand(
        Array.from({ length: 99 }, (_, i) => `${i}.jpg`),
        SOUGHT,
      ),
    ).toContain(" boards --board"));
  test("prints the board, with its markers", () => {
    expect(
      printCommand({ ...BOARD, kind: "charuco", marker_mm: 20, family: "4X4_50", legacy: true }),
    ).toBe(
      "omnimirror board --board 11x7 --square-mm 30 --target charuco --set board.marker_mm=20 --set board.family=4X4_50 --set board.legacy=true -o board.pdf",
    );
    expect(printCommand({ ...BOARD, kind: "aprilgrid", spacing: 0.25 })).toContain(
      "--target aprilgrid --set board.spacing=0.25",
    );
  });
});

test("pictures have names of their own", () => {
  expect(unlike("a.jpg", new Set())).toBe("a.jpg");
  expect(unlike("a.jpg", new Set(["a.jpg", "a.jpg (2)"]))).toBe("a.jpg (3)");
});

test("a rim is the middle of those that are sure, if most are", () => {
  const rim = (u: number, radius_px: number, is_reliable = true): DetectedOutline => ({
    centre_px: [u, 100],
    radius_px,
    confidence: is_reliable ? 0.9 : 0.2,
    is_reliable,
    image_size: [640, 480],
  });
  expect(rimOf([rim(320, 220), rim(322, 224), rim(900, 20, false)])).toEqual({
    centre: [321, 100],
    radius: 222,
  });
  expect(rimOf([rim(320, 220), rim(1, 1, false), rim(900, 20, false)])).toBeNull();
  expect(rimOf([])).toBeNull();
});

test("it is said why none can begin", () => {
  expect(whyNot(12, 1)).toBe("One image has not been processed yet.");
  expect(whyNot(2, 0)).toContain("in 2 images; at least 3 are required");
  expect(whyNot(3, 0)).toBeNull();
});

test("a fisheye is not offered what only mirrors are", () => {
  const start = { models: ["unified", "sensor"], mirrors_only: ["sensor"], families: [] };
  expect(modelsFor(start, "mirror")).toEqual(["auto", "unified", "sensor"]);
  expect(modelsFor(start, "fisheye")).toEqual(["auto", "unified"]);
  expect([modelWords("radial-spline"), px(0.12345), px(null)]).toEqual([
    "radial spline",
    "0.123 px",
    "–",
  ]);
});

test("what was found is said, or why not", () => {
  const visible = { ids: [1, 2, 3] } as BoardDetection;
  expect([stateWords(visible, null), stateWords(visible, "the picture is blank")]).toEqual([
    "3 corners",
    "The picture is blank",
  ]);
});

const COVERAGE: CoverageInfo = {
  centre_px: [50, 40],
  radii_px: [0, 10, 20],
  counts: [
    [0, 9, 9, 9],
    [1, 2, 30, 5],
  ],
  min_corners: 5,
};

test("cells lie where their corners are counted", () => {
  const cells = cellsOf(COVERAGE);
  expect(coveredIn(COVERAGE)).toEqual([5, 8]);
  expect(cells.map((c) => c.count)).toEqual(COVERAGE.counts.flat());
  const numbers = (path: string): number[] =>
    [...path.matchAll(/-?[\d.]+/g)].map((m) => Number(m[0]));
  for (const { ring, sector, path } of cells) {
    const [u, v] = numbers(path.slice(path.indexOf("L")));
    const [x, y] = [u - 50, v - 40];
    expect(Math.hypot(x, y)).toBeCloseTo(COVERAGE.radii_px[ring + 1], 1);
    const off = Math.atan2(y, x) - (sector * Math.PI) / 2 + Math.PI / 4; // its first edge, 22.5 deg before its centre
    expect(Math.cos(off)).toBeCloseTo(1, 3);
  }
});

test("residuals along and across the radius", () => {
  const [[radius, along, across]] = byRadius([[53, 44, 0.3, 0.4]], [50, 40]); // outwards
  expect([radius, along, across]).toEqual([5, expect.closeTo(0.5), expect.closeTo(0)]);
  const [[, inward, turned]] = byRadius([[60, 40, 0, 2]], [50, 40]);
  expect([inward, turned]).toEqual([0, 2]);
});

test("what is drawn", () => {
  expect(crosses([[10, 20]], 2)).toBe("M8 20h4M10 18v4");
  expect(dots([[1, 2]])).toBe("M1 2h0");
  expect(arrows([[10, 20, 0.5, -0.25]], 20)).toBe("M10 20L20 15");
  expect([timesFor(0.2, 12), timesFor(0.13, 12), timesFor(30, 12), timesFor(0, 12)]).toEqual([
    50, 50, 1, 1,
  ]);
});

test("a board that stands still moves by little, one that is another by infinity", () => {
  const before = {
    ids: [0, 1, 2, 3],
    corners_px: [
      [0, 0],
      [10, 0],
      [0, 10],
      [10, 10],
    ] as [number, number][],
  };
  const now = {
    ids: [1, 2, 3, 4],
    corners_px: [
      [13, 4],
      [3, 14],
      [13, 14],
      [9, 9],
    ] as [number, number][],
    image_size: [100, 50] as [number, number],
  };
  expect(movedBy(before, now)).toBeCloseTo(0.05);
  expect(movedBy(null, now)).toBe(Infinity);
  expect(movedBy(before, { ...now, ids: [7, 8, 9, 10] })).toBe(Infinity);
});

test("a question travels with its file behind it", async () => {
  const { header, start } = unpack<{ name: string }>(
    await pack({ name: "käse" }, new Blob(["abc"])).arrayBuffer(),
  );
  expect(header).toEqual({ name: "käse" });
  expect(start).toBe(4 + new TextEncoder().encode('{"name":"käse"}').length);
});
