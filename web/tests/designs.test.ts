/** Designs of the Design tab: address, undo history, validation. */
import { beforeEach, describe, expect, test, vi } from "vitest";
import { fromAddress, inAddress } from "../src/design/model/address";
import { History, placed, withEntry, type Design, type Tables } from "../src/design/model/design";
import { keep, stored } from "../src/design/model/storage";
import { lacking } from "../src/design/model/validation";
import type { DesignStart, DesignSummary, ParameterInfo, PartInfo } from "../src/shared/messages";

const number = (name: string, more: Partial<ParameterInfo> = {}): ParameterInfo => ({
  name,
  unit: "mm",
  low: 0,
  high: 1e3,
  description: "",
  choices: [],
  is_list: false,
  is_integer: false,
  is_optional: false,
  default: null,
  ...more,
});
const part = (kind: string, ...parameters: ParameterInfo[]): PartInfo => ({ kind, parameters });

const PARTS = {
  mirrors: [
    part("sphere", number("radius_mm"), number("rim_radius_mm")),
    part("polynomial", number("coefficients", { is_list: true })),
  ],
  secondaries: [part("flat", number("radius_mm"))],
  lenses: [
    part("perspective", number("focal_length_mm"), number("k1", { is_optional: true, default: 0 })),
    part("orthographic"),
  ],
  imager: part("imager", number("width_px", { is_integer: true })),
  secondary_position: part("place", number("z_mm")),
  quantities: [{ name: "blur_px", unit: "px", meaning: "" }],
} as unknown as DesignStart;

const DESIGN: Design = {
  tables: {
    name: "mine",
    mirror: { kind: "sphere", radius_mm: 25, rim_radius_mm: 40 },
    lens: { kind: "perspective", focal_length_mm: 8 },
    imager: { width_px: 1024 },
    mount: { mirror_distance_mm: 150 },
  },
  follows_mapping: false,
  distance: 2000,
  requirements: { field: { omega_max_deg: 120 }, limit: [{ quantity: "blur_px", at_most: 3 }] },
};

const changed = (change: (d: Tables) => void): Design => {
  const design = structuredClone(DESIGN);
  change(design);
  return design;
};

describe("addresses", () => {
  test.each([
    DESIGN,
    { ...DESIGN, distance: null, requirements: null },
    { ...DESIGN, follows_mapping: true },
  ])("a design comes back", (design) =>
    expect(fromAddress(inAddress(design), PARTS)).toEqual(design),
  );

  test("what an older page left out is as at first", () => {
    const { tables } = DESIGN;
    expect(fromAddress(JSON.stringify({ tables, colour: "red" }), PARTS)).toEqual({
      tables,
      follows_mapping: false,
      distance: null,
      requirements: null,
    });
  });

  test("one that was cut off is said to be", () =>
    expect(fromAddress(inAddress(DESIGN).slice(0, -9), PARTS)).toBe(
      "The design in the address is invalid: the link is incomplete or was changed.",
    ));

  test("one that is too long for an address is in none", () =>
    expect(inAddress(withEntry(DESIGN, "mirror", "coefficients", Array(4000).fill(1)))).toBe(""));
});

describe("what is no design says what it lacks", () => {
  test("a whole one lacks nothing", () => expect(lacking(DESIGN, PARTS)).toBeNull());

  test.each<[unknown, string]>([
    [null, "it must be a design"],
    [[], "it must be a design"],
    ["sphere", "it must be a design"],
    [{}, "it must contain the tables of a sensor"],
    [changed((d) => delete d.tables.lens), "[lens] is missing"],
    [
      changed((d) => (d.tables.mirror.kind = "spher")),
      "mirror.kind must be one of sphere, polynomial",
    ],
    [changed((d) => delete d.tables.mirror.radius_mm), "mirror.radius_mm is missing"],
    [
      changed((d) => (d.tables.mirror.radius_mm = "25")),
      'mirror.radius_mm must be a number; got "25"',
    ],
    [
      changed((d) => (d.tables.mirror = { kind: "polynomial", coefficients: [1, null] })),
      "mirror.coefficients must be a list of numbers; got [1,null]",
    ],
    [changed((d) => (d.tables.lens.k1 = {})), "lens.k1 must be a number; got {}"],
    [changed((d) => delete d.tables.mount), "mount.mirror_distance_mm is missing"],
    [changed((d) => (d.tables.mount = 3)), "mount must be a table; got 3"],
    [
      changed((d) => (d.tables.mirror_pose = { decentre_x_mm: "far" })),
      "mirror_pose must be a table of numbers",
    ],
    [
      changed((d) => (d.tables.secondary = { kind: "flat", radius_mm: 5 })),
      "secondary.z_mm is missing",
    ],
    [changed((d) => (d.distance = "far")), 'the object distance must be positive; got "far"'],
    [changed((d) => (d.tables.name = 7)), "name must be a text; got 7"],
    [changed((d) => (d.requirements.field = [])), "[field] of the requirements is missing"],
    [
      changed((d) => (d.requirements.field = {})),
      "field.omega_max_deg of the requirements is missing",
    ],
    [changed((d) => (d.requirements.limit = {})), "the limits of the requirements must be a list"],
    [
      changed((d) => (d.requirements.limit = [{ quantity: "beauty" }])),
      'the requirements contain an unknown quantity, "beauty"',
    ],
  ])("%j", (result, status) => {
    expect(lacking(result, PARTS)).toBe(status);
    expect(fromAddress(JSON.stringify(result), PARTS)).toBe(
      `The design in the address is invalid: ${status}.`,
    );
  });

  test("a lens that follows the mirror, or stands infinitely far, needs no distance", () => {
    expect(
      lacking({ ...changed((d) => delete d.tables.mount), follows_mapping: true }, PARTS),
    ).toBeNull();
    expect(
      lacking(
        changed((d) => {
          Object.assign(d.tables, { lens: { kind: "orthographic" }, mount: undefined });
        }),
        PARTS,
      ),
    ).toBeNull();
  });
});

describe("undoing", () => {
  const at = (radius: number): Design => withEntry(DESIGN, "mirror", "radius_mm", radius);

  test("a slider that is held is undone in one step", () => {
    const history = new History(at(25));
    for (const radius of [26, 27, 28]) history.now = at(radius);
    expect(history.settle()).toBe(true);
    expect(history.settle()).toBe(false);
    history.undo();
    expect(history.now).toEqual(at(25));
    expect([history.canUndo, history.canRedo]).toEqual([false, true]);
    history.redo();
    expect(history.now).toEqual(at(28));
  });

  test("successive key presses on one control are one step", () => {
    const history = new History(at(25));
    const press = (radius: number, control: string | null): void => {
      history.now = at(radius);
      history.settle(control);
    };
    for (const radius of [26, 27, 28, 29, 30]) press(radius, "mirror.radius_mm");
    history.undo();
    expect(history.now).toEqual(at(25));
    history.redo();
    press(31, "mirror.radius_mm");
    history.undo();
    expect(history.now).toEqual(at(30)); // Redo ends the step
    press(32, "lens.f_number");
    press(33, "mirror.radius_mm");
    history.settle(null); // the control loses the focus
    press(34, "mirror.radius_mm");
    press(35, null); // by the pointer
    for (const radius of [34, 33, 32, 30]) {
      history.undo();
      expect(history.now).toEqual(at(radius));
    }
  });

  test("what was not yet settled on is undone too", () => {
    const history = new History(at(25));
    history.now = at(26);
    history.undo();
    expect(history.now).toEqual(at(25));
  });

  test("a change after Undo ends what could be redone; a hundred are kept", () => {
    const history = new History(at(0));
    for (let i = 1; i <= 130; i++) {
      history.now = at(i);
      history.settle();
    }
    history.undo();
    history.now = at(7);
    history.settle();
    expect(history.canRedo).toBe(false);
    let steps = 0;
    for (; history.canUndo; steps++) history.undo();
    expect(steps).toBe(100);
  });

  test("what the server completes is no step of its own", () => {
    const history = new History({ ...DESIGN, follows_mapping: true });
    const complete = placed(history.now, { mirror_distance_mm: 161.5 } as DesignSummary);
    history.complete(complete);
    expect(history.settle()).toBe(false);
    expect(history.now.tables.mount.mirror_distance_mm).toBe(161.5);
    expect(placed(DESIGN, { mirror_distance_mm: 161.5 } as DesignSummary)).toBe(DESIGN); // without follows
  });

  test("one number of a list changes, and the design before stays as it was", () => {
    const before = changed(
      (d) => (d.tables.mirror = { kind: "polynomial", coefficients: [1, 2, 3] }),
    );
    expect(withEntry(before, "mirror", "coefficients", 9, 1).tables.mirror.coefficients).toEqual([
      1, 9, 3,
    ]);
    expect(before.tables.mirror.coefficients).toEqual([1, 2, 3]);
  });
});

describe("what the browser keeps", () => {
  const area = (): Storage => {
    const texts = new Map<string, string>();
    return {
      getItem: (key: string) => texts.get(key) ?? null,
      setItem: (key: string, text: string) => void texts.set(key, text),
    } as unknown as Storage;
  };
  beforeEach(() => {
    vi.stubGlobal("sessionStorage", area());
    vi.stubGlobal("localStorage", area());
  });

  test("comes back, of this tab first", () => {
    expect(stored(PARTS)).toBeNull();
    const history = new History(DESIGN);
    history.now = withEntry(DESIGN, "mirror", "radius_mm", 30);
    history.settle();
    keep(history, [{ name: "pinned", design: DESIGN }], ["Image"]);
    expect(stored(PARTS)).toEqual({
      design: history.now,
      past: [DESIGN],
      future: [],
      pins: [{ name: "pinned", design: DESIGN }],
      switched: ["Image"],
    });
    vi.stubGlobal("sessionStorage", area());
    keep(new History(DESIGN), [], []);
    vi.stubGlobal("localStorage", area());
    expect(stored(PARTS)?.design).toEqual(DESIGN);
  });

  test("without what is no design", () => {
    sessionStorage.setItem(
      "omnimirror-design",
      JSON.stringify({
        design: {},
        past: [DESIGN, 3],
        pins: [{ name: "a", design: DESIGN }, { name: 3 }, null],
        switched: "all",
      }),
    );
    expect(stored(PARTS)).toEqual({
      design: null,
      past: [],
      future: [],
      pins: [{ name: "a", design: DESIGN }],
      switched: [],
    });
    sessionStorage.setItem("omnimirror-design", "{cut o");
    expect(stored(PARTS)).toBeNull();
  });
});
