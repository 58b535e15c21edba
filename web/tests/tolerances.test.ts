import { expect, test } from "vitest";
import {
  capital,
  enlargement,
  errorWords,
  gradeTolerances,
  meritName,
  sizeWords,
} from "../src/design/tolerances/names";

test("errors are called by their part and what errs, without units", () => {
  expect(errorWords("mirror.decentre_x_mm")).toBe("Mirror decentre x");
  expect(errorWords("imager.pitch_ppm")).toBe("Imager pitch");
  expect(errorWords("mirror.zernike_5_um")).toBe("Mirror form Z5");
  expect(errorWords("lens.f_number")).toBe("Lens F-number");
  expect(errorWords("temperature.warmer_k")).toBe("Temperature warmer");
  expect(capital("place of the mirror")).toBe("Place of the mirror");
});

test("motions are enlarged by 1, 2, 5, .. and never longer than they may be", () => {
  for (const maximum of [1e-9, 0.003, 0.17, 1.69, 40, 400]) {
    const times = enlargement(maximum, 80);
    expect([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]).toContain(times);
    if (times > 1) expect(times * maximum).toBeLessThanOrEqual(80);
    if (times < 1000) expect(2.5 * times * maximum).toBeGreaterThanOrEqual(80);
  }
});

test("what is nothing is told as that", () => {
  expect(sizeWords(1e-7, " px")).toBe("< 0.001 px");
  expect(sizeWords(1.694, " px")).toBe("1.69 px");
  expect(sizeWords(null, "°")).toBe("–°");
});

test("merits after calibrations, and tolerances of a grade", () => {
  expect(meritName("motion_px", "none")).toBe("motion_px");
  expect(meritName("motion_px", "pose")).toBe("motion_px after pose");
  const error = {
    name: "lens.k1",
    unit: "",
    meaning: "",
    group: "distortion",
    coarse: 3,
    medium: 2,
    fine: 1,
  };
  expect(gradeTolerances([error], "fine").get("lens.k1")).toBe(1);
});
