/** Where a slider could stand for all requirements to be met. */

/** Part of a slider, from one place on it to another, 0 to 1. */
export type Span = readonly [from: number, to: number];

const STEPS = 8;

/** Places at which it is looked: even ones, and where the slider stands. */
export const placesWith = (place: number): number[] =>
  [...new Set([...Array.from({ length: STEPS + 1 }, (_, i) => i / STEPS), place])].sort(
    (a, b) => a - b,
  );

/** By how much each requirement is missed, below 0 kept; null where there is no design. */
export type Missed = readonly number[] | null;

/** Parts of a slider where nothing is missed, by what is missed at places; between two of them it is taken to go straight. */
export function metSpans(places: readonly number[], missed: readonly Missed[]): Span[] {
  const spans: [number, number][] = [];
  for (let i = 0; i + 1 < missed.length; i++) {
    const span = metBetween(missed[i], missed[i + 1]);
    if (!span) continue;
    const [from, to] = span.map((share) => places[i] + share * (places[i + 1] - places[i]));
    const last = spans.at(-1);
    if (last?.[1] === from) last[1] = to;
    else spans.push([from, to]);
  }
  return spans;
}

/** The part of the way from one place to the next where all are met; next to what cannot be it is half of it. */
function metBetween(left: Missed, right: Missed): Span | null {
  if (!left || !right || left.length !== right.length) {
    const isMet = [left, right].map((missed) => missed?.every((m) => m <= 0));
    return isMet[0] === isMet[1] ? null : isMet[0] ? [0, 0.5] : isMet[1] ? [0.5, 1] : null;
  }
  let [from, to] = [0, 1];
  left.forEach((l, i) => {
    const r = right[i];
    if (l > 0 && r > 0) to = -1;
    else if (l > 0) from = Math.max(from, l / (l - r));
    else if (r > 0) to = Math.min(to, l / (l - r));
  });
  return from < to ? [from, to] : null;
}
