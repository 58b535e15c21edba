import type { ParameterOf } from "./messages";

/** Between a slider's place, 0 to 1, and a value. */
export interface Scale {
  low: number;
  high: number;
  to: (place: number) => number;
  from: (value: number) => number;
}

const clamp = (x: number, low: number, high: number): number => Math.min(high, Math.max(low, x));
const REACH = 2.5;
const TINY = 1e-9; // rounding
const WIDEST = 400; // a range that a slider shows whole

/** A slider around a value: the whole range where that is short, factors of what is positive, or some to either side. */
export function scaleOf(p: ParameterOf, value: number): Scale {
  if (p.high - p.low <= WIDEST) return even(p.low, p.high, p);
  if (p.low > 0 && value > 0) {
    const low = Math.max(p.low, value / REACH);
    const ratio = Math.log(Math.min(p.high, value * REACH) / low);
    return { low, high: low * Math.exp(ratio), to: (x) => rounded(low * Math.exp(x * ratio), p), from: (v) => clamp(Math.log(v / low) / ratio, 0, 1) };
  }
  const span = value === 0 ? 0.1 * Math.min(1, p.high) : Math.abs(value);
  return even(Math.max(p.low, value - span), Math.min(p.high, value + span), p);
}

function even(low: number, high: number, p: ParameterOf): Scale {
  return { low, high, to: (x) => clamp(rounded(low + x * (high - low), p, high - low), p.low, p.high), from: (v) => clamp((v - low) / (high - low), 0, 1) };
}

/** No finer than a slider can be set. */
function rounded(value: number, p: ParameterOf, span = Math.abs(value)): number {
  if (p.is_whole) return Math.round(value);
  if (span === 0) return value;
  const digits = 3 - Math.floor(Math.log10(span));
  return digits > 15 ? value : Number(value.toFixed(Math.max(0, digits)));
}

/** A number as people write it, with so many digits that matter. */
export function words(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value) < TINY ? 0 : Math.abs(value);
  if (size === 0) return "0";
  const text = size >= 1e6 || size < 1e-4 ? value.toExponential(digits - 1) : plain(value, digits);
  return text.replace("-", "−");
}

/** A number with so many decimals. */
export const fixed = (value: number, places: number): string => (Number.isFinite(value) ? value.toFixed(places).replace("-", "−") : "–");

function plain(value: number, digits: number): string {
  const places = clamp(digits - 1 - Math.floor(Math.log10(Math.abs(value))), 0, 8);
  return value.toFixed(places);
}

const UNITS: Record<string, string> = { deg: "°", um: "µm", deg2: "deg²", "px/deg": "px/°" };
export const unitWords = (unit: string): string => UNITS[unit] ?? unit;

/** A parameter's name without its unit. */
export const label = (name: string): string => {
  const text = name.replace(/_(mm|um|deg|px)$/, "").replaceAll("_", " ");
  const said = text.replace(/^(omega|theta) (max|min)$/, (_, angle: string, end: string) => `${angle === "omega" ? "Ω" : "Θ"} ${end}`);
  return said.replace(/^f number$/, "F-number").replace(/^working f number$/, "working F-number").replace(/^./, (c) => c.toUpperCase());
};
