import type { ErrorSourceInfo } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { label } from "../labels";

/** Displayed names of calibrations. */
const CALIBRATIONS: Record<string, string> = {
  none: "as built",
  "principal-point": "principal point",
  affine: "affine",
  pose: "mirror pose",
  radial: "radial mapping",
};
export const calibrationWords = (name: string): string => CALIBRATIONS[name] ?? name;

/** Return the displayed name of a displacement merit after a calibration. */
export const meritName = (quantity: string, after: string): string =>
  after === "none" ? quantity : `${quantity} after ${after}`;

/** Return part and parameter of an error: "imager.tilt_x_deg" is "Imager" and "tilt x". */
export function partAndError(name: string): [string, string] {
  const [part, own] = name.split(/\.(.*)/);
  const text = label((own ?? name).replace(/_ppm$|_k$/, "")).replace(/^Zernike (\d+)$/, "Form Z$1");
  return [
    capital(part),
    /^[A-Z][a-z]/.test(text) ? text.replace(/^./, (c) => c.toLowerCase()) : text,
  ];
}

export const errorWords = (name: string): string => partAndError(name).join(" ");

export const capital = (text: string): string => text.replace(/^./, (c) => c.toUpperCase());

const STEPS = [1, 2, 5, 10];
const MAX_TIMES = 1000;
const NOTHING = 5e-4; // px or degrees: resolution of displayed values

/** Format a number of px or degrees. */
export const sizeWords = (value: number | null | undefined, unit: string): string =>
  typeof value === "number" && value < NOTHING ? `< 0.001${unit}` : `${words(value, 3)}${unit}`;

/** Return the magnification of displacements, 1, 2, 5, ... 1000, for a given maximum length. */
export function enlargement(displacement: number, maxLength: number): number {
  let times = 1;
  for (let power = 1; power < MAX_TIMES; power *= 10)
    for (const step of STEPS) if (step * power * displacement <= maxLength) times = step * power;
  return times;
}

/** Tolerances of a tolerance grade. */
export const gradeTolerances = (
  errors: readonly ErrorSourceInfo[],
  grade: "coarse" | "medium" | "fine",
): Map<string, number> => new Map(errors.map((e) => [e.name, e[grade]]));
