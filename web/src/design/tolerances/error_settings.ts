import { parsed } from "../../shared/storage";

export const GRADES = ["coarse", "medium", "fine"] as const;
export const FOCUSES = ["none", "rms", "worst"] as const;
export const MEASURES = [
  "motion_px",
  "direction_error_deg",
  "straightness_deg",
  "blur_px",
] as const;
const MOST = 200; // a sensor has a few dozen error sources

/** Errors, and requirement of the yield. */
export interface ErrorSettings {
  grade: (typeof GRADES)[number];
  focus: (typeof FOCUSES)[number];
  /** Calibration of the requirement; unknown names are rejected by the server. */
  after: string;
  quantity: (typeof MEASURES)[number];
  /** Upper limit; 0 if empty. */
  limit: number;
  /** Non-zero errors by name. */
  values: Record<string, number>;
  /** Tolerances that differ from those of the grade. */
  tolerances: Record<string, number>;
}

export const textOf = (settings: ErrorSettings): string => JSON.stringify(settings);

/** Parse the errors of a text; null if invalid. */
export function errorSettingsOf(text: string): ErrorSettings | null {
  const result = parsed(text) as Partial<Record<keyof ErrorSettings, unknown>> | null | undefined;
  if (typeof result !== "object" || result === null) return null;
  const isOne = (all: readonly string[], value: unknown): boolean => all.includes(value as string);
  const isWhole =
    isOne(GRADES, result.grade) &&
    isOne(FOCUSES, result.focus) &&
    isOne(MEASURES, result.quantity) &&
    typeof result.after === "string";
  const isGood =
    isWhole &&
    isSize(result.limit) &&
    isTable(result.values, Number.isFinite) &&
    isTable(result.tolerances, isSize);
  return isGood ? (result as ErrorSettings) : null;
}

const isSize = (value: unknown): boolean => Number.isFinite(value) && (value as number) >= 0;
const isTable = (table: unknown, isGood: (value: unknown) => boolean): boolean =>
  typeof table === "object" &&
  table !== null &&
  !Array.isArray(table) &&
  Object.values(table).length <= MOST &&
  Object.values(table).every(isGood);
