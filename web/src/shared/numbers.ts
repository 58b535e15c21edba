const TINY = 1e-9; // rounding errors

export const clamp = (x: number, low: number, high: number): number =>
  Math.min(high, Math.max(low, x));

/** Wrap an angle in degrees to -180 to 180. */
export const wrapped = (deg: number): number => ((((deg + 180) % 360) + 360) % 360) - 180;

/** Format a number with a given number of significant digits. */
export function words(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value) < TINY ? 0 : Math.abs(value);
  if (size === 0) return "0";
  const text = size >= 1e6 || size < 1e-4 ? value.toExponential(digits - 1) : plain(value, digits);
  return text.replace("-", "−");
}

/** Format a number with a given number of decimals. */
export const fixed = (value: number, places: number): string =>
  Number.isFinite(value) ? value.toFixed(places).replace("-", "−") : "–";

function plain(value: number, digits: number): string {
  const places = clamp(digits - 1 - Math.floor(Math.log10(Math.abs(value))), 0, 8);
  return value.toFixed(places);
}

/** Return the smallest number of the series 1, 2, 5, 10, ... that is not below a positive value. */
export function roundUp(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((k) => Number((k * power).toPrecision(1))).find((x) => x >= value)!;
}
