import type { ParameterInfo } from "../../shared/messages";
import { clamp } from "../../shared/numbers";

/** Mapping between slider position, 0 to 1, and value. */
export interface Scale {
  low: number;
  high: number;
  to: (place: number) => number;
  from: (value: number) => number;
}

const REACH = 2.5;
const MAX_RANGE = 400; // maximum width of a range that the slider covers completely

/** Return a slider scale around a value: complete range if short, logarithmic for positive values, or an interval around the value. */
export function scaleOf(p: ParameterInfo, value: number): Scale {
  if (p.high - p.low <= MAX_RANGE) return even(p.low, p.high, p);
  if (p.low > 0 && value > 0) {
    const low = Math.max(p.low, value / REACH);
    const ratio = Math.log(Math.min(p.high, value * REACH) / low);
    return {
      low,
      high: low * Math.exp(ratio),
      to: (x) => rounded(low * Math.exp(x * ratio), p),
      from: (v) => (v > low ? Math.min(1, Math.log(v / low) / ratio) : 0),
    };
  }
  const span = value === 0 ? 0.1 * Math.min(1, p.high) : Math.abs(value);
  return even(Math.max(p.low, value - span), Math.min(p.high, value + span), p);
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
