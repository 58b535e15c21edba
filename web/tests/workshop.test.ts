/** Workshop data of the export. */
import { expect, test } from "vitest";
import { entered, workshopOf } from "../src/design/model/workshop";

test("an empty number has its default, and texts are trimmed", () => {
  const [number, text] = [{ max_length: null }, { max_length: 26 }];
  expect(entered(number, "")).toBeNull();
  expect(entered(number, "0.2")).toBe(0.2);
  expect(entered(text, " brass ")).toBe("brass");
  expect(entered(text, "")).toBe("");
});

test("stored data of other types are omitted", () => {
  expect(workshopOf(null)).toEqual({});
  expect(workshopOf("[1]")).toEqual({});
  expect(workshopOf("{")).toEqual({});
  const stored = { mirror: { material: "brass", form_um: null, coating: [1] }, title: 3 };
  expect(workshopOf(JSON.stringify(stored))).toEqual({
    mirror: { material: "brass", form_um: null },
  });
});
