import { expect, test } from "vitest";
import { explained, labelledMessage, quantityWords, symbolOf } from "../src/design/labels";

const BLUR = {
  name: "blur_t_deg",
  symbol: "Δ_t/Δh",
  unit: "deg",
  title: "Blur T",
  meaning: "blur in the angle of the object",
  equation: "Δ_t / Δh, Eq. 36",
};
const ASPECT = {
  name: "aspect",
  symbol: "Δw/Δh",
  unit: "",
  title: "Aspect",
  meaning: "width to height",
  equation: "",
};

test("quantities are called by title and unit", () => {
  expect(quantityWords(BLUR)).toBe("Blur T, °");
  expect(quantityWords(ASPECT)).toBe("Aspect");
});

test("messages start with the label of a parameter", () => {
  expect(labelledMessage("rim_radius_mm must be less than 50 mm; got 60")).toBe(
    "Rim radius must be less than 50 mm; got 60",
  );
  expect(labelledMessage("f_number must be positive; got 0")).toBe(
    "F-number must be positive; got 0",
  );
  expect(labelledMessage("the lens must image each angle once")).toBe(
    "The lens must image each angle once",
  );
});

test("messages contain titles and labels instead of internal names", () => {
  expect(labelledMessage("relaxation 2 of 3: blur_t_deg", [BLUR])).toBe(
    "Relaxation 2 of 3: blur T",
  );
  expect(labelledMessage("Mirror.radius_mm must be positive; got -5")).toBe(
    "Radius must be positive; got -5",
  );
  expect(labelledMessage("paper-spherical.toml: omega_max_deg is too large")).toBe(
    "Paper-spherical.toml: Ω max is too large",
  );
});

test("what stands after an underscore is a subscript, in symbols and in equations", () => {
  expect(symbolOf(BLUR)).toBe("Δₜ/Δh");
  expect(symbolOf({ ...BLUR, symbol: "z_v" })).toBe("zᵥ");
  expect(explained(BLUR)).toBe("blur in the angle of the object (Δₜ / Δh, Eq. 36)");
  expect(explained(ASPECT)).toBe("width to height");
});
