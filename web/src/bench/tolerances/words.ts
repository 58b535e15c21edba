import type { ErrorOf } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { label } from "../labels";

/** Kinds of calibrations, as the page calls them. */
const CALIBRATIONS: Record<string, string> = {
  none: "as built",
  "principal-point": "principal point",
  affine: "affine",
  pose: "mirror pose",
  radial: "radial mapping",
};
export const calibrationWords = (name: string): string => CALIBRATIONS[name] ?? name;

/** What of a motion a merit's name says, after a calibration. */
export const meritName = (quantity: string, after: string): string =>
  after === "none" ? quantity : `${quantity} after ${after}`;

/** A part and what errs of it: "imager.tilt_x_deg" is "Imager" and "tilt x". */
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
const MOST_TIMES = 1000;
const NOTHING = 5e-4; // px or degrees: less is not told

/** A number of px or degrees, as far as it matters. */
export const sizeWords = (value: number | null | undefined, unit: string): string =>
  typeof value === "number" && value < NOTHING ? `< 0.001${unit}` : `${words(value, 3)}${unit}`;

/** By how much small motions are enlarged: 1, 2, 5, .. 1000, so that the largest is so long at most. */
export function enlargement(largest: number, most: number): number {
  let times = 1;
  for (let power = 1; power < MOST_TIMES; power *= 10)
    for (const step of STEPS) if (step * power * largest <= most) times = step * power;
  return times;
}

/** Tolerances as a shop of a grade holds them. */
export const held = (
  errors: readonly ErrorOf[],
  grade: "coarse" | "medium" | "fine",
): Map<string, number> => new Map(errors.map((e) => [e.name, e[grade]]));
