/** Logarithmic axis with a tick at each decade. */
interface LogAxis {
  ticks: number[];
  /** Position of a value, 0 to 1; values below the first tick are at 0. */
  place: (value: number) => number;
}

const MAX_DECADES = 5;
const EMPTY = 1; // upper end without positive values

/** Return the axis of positive values: whole decades, at most the upper five. */
export function logAxis(values: readonly number[]): LogAxis {
  const positive = values.filter((v) => v > 0 && Number.isFinite(v));
  const high = Math.ceil(Math.log10(Math.max(...positive, 0) || EMPTY) - 1e-9);
  const lowest = Math.floor(Math.log10(Math.min(...positive, 10 ** high)) + 1e-9);
  const low = Math.min(high - 1, Math.max(lowest, high - MAX_DECADES));
  return {
    ticks: Array.from({ length: high - low + 1 }, (_, i) => Number(`1e${low + i}`)),
    place: (value) =>
      value > 0 ? Math.min(1, Math.max(0, (Math.log10(value) - low) / (high - low))) : 0,
  };
}
