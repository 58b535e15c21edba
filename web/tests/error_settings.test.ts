import { expect, test } from "vitest";
import {
  textOf,
  type ErrorSettings,
  errorSettingsOf,
} from "../src/design/tolerances/error_settings";

const TRYING: ErrorSettings = {
  grade: "fine",
  focus: "rms",
  after: "pose",
  quantity: "blur_px",
  limit: 0.25,
  values: { "mirror.tilt_y_deg": -0.2 },
  tolerances: { "lens.k1": 0 },
};

test("what is tried comes back from its text", () => {
  expect(errorSettingsOf(textOf(TRYING))).toEqual(TRYING);
  expect(errorSettingsOf(textOf({ ...TRYING, limit: 0, values: {} }))).toEqual({
    ...TRYING,
    limit: 0,
    values: {},
  });
});

test.each([
  ["", "nothing"],
  ["null", "nothing"],
  ["[]", "a list"],
  [textOf(TRYING).slice(0, -1), "cut off"],
  [textOf({ ...TRYING, grade: "finest" as "fine" }), "a grade that is none"],
  [textOf({ ...TRYING, quantity: "toString" as "blur_px" }), "a quantity that is none"],
  [textOf({ ...TRYING, limit: -1 }), "a limit below 0"],
  [textOf({ ...TRYING, values: { a: "1" as unknown as number } }), "a text for a number"],
  [textOf({ ...TRYING, values: [1] as unknown as ErrorSettings["values"] }), "a list for a table"],
  [textOf({ ...TRYING, tolerances: { a: -0.1 } }), "a tolerance below 0"],
  [
    textOf({ ...TRYING, values: Object.fromEntries([...Array(201).keys()].map((i) => [i, 1])) }),
    "more errors than a sensor has",
  ],
])("%s is none: %s", (text) => {
  expect(errorSettingsOf(text)).toBeNull();
});
