import type { ParameterInfo } from "../../shared/messages";
import { clamp, roundUp } from "../../shared/numbers";

/** Mapping between slider position, 0 to 1, and value. */
export interface Scale {
  low: number;
  high: number;
  to: (place: number) => number;
  from: (value: number) => number;
}

const DECADE = 10; // ratio of the ends of a logarithmic slider
const STARTS = [1, 3]; // leading digits of the lower end
const MIN_PLACE = 0.25; // minimum position of the value on a logarithmic slider
const MAX_RANGE = 400; // maximum width of a range that the slider covers completely

/** Return a slider scale that contains a value: complete range if short, one decade with round ends for positive values, otherwise an interval with round ends around 0. The ends depend on the order of magnitude only, so that the handle displays the position of the value between them; values outside the permitted range are replaced by its ends. */
export function scaleOf(p: ParameterInfo, value: number): Scale {
  if (p.high - p.low <= MAX_RANGE) return even(p.low, p.high, p);
  const inside = clamp(value, p.low, p.high);
  if (p.low > 0) return decade(p, inside);
  const end = inside === 0 ? 0.1 * Math.min(1, p.high) : roundUp(2 * Math.abs(inside) * (1 - 1e-9));
  return even(Math.max(p.low, -end), Math.min(p.high, end), p);
}

function decade(p: ParameterInfo, value: number): Scale {
  const power = 10 ** Math.floor(Math.log10(value));
  const starts = [power / DECADE, power].flatMap((x) => STARTS.map((k) => k * x));
  const start = starts.filter((x) => Math.log10(value / x) >= MIN_PLACE).at(-1)!;
  const low = Math.max(p.low, Number(start.toPrecision(1)));
  const high = Math.min(p.high, Number((DECADE * start).toPrecision(1)));
  const ratio = Math.log(high / low);
  return {
    low,
    high,
    to: (x) => clamp(rounded(low * Math.exp(x * ratio), p), p.low, p.high),
    from: (v) => (v > low ? Math.min(1, Math.log(v / low) / ratio) : 0),
  };
}

function even(low: number, high: number, p: ParameterInfo): Scale {
  return {
    low,
    high,
    to: (x) => clamp(rounded(low + x * (high - low), p, high - low), p.low, p.high),
    from: (v) => clamp((v - low) / (high - low), 0, 1),
  };
}

/** Round to the resolution of a slider. */
function rounded(value: number, p: ParameterInfo, span = Math.abs(value)): number {
  if (p.is_integer) return Math.round(value);
  if (span === 0) return value;
  const digits = 3 - Math.floor(Math.log10(span));
  return digits > 15 ? value : Number(value.toFixed(Math.max(0, digits)));
}
