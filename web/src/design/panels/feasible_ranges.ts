/** Feasible range of a slider with respect to the requirements. */

/** Interval of slider positions, 0 to 1. */
export type Span = readonly [from: number, to: number];

const STEPS = 8;

/** Return the sampled positions: equidistant, and the current one. */
export const placesWith = (place: number): number[] =>
  [...new Set([...Array.from({ length: STEPS + 1 }, (_, i) => i / STEPS), place])].sort(
    (a, b) => a - b,
  );

/** Violation of each requirement, negative if met; null for an invalid design. */
export type Violations = readonly number[] | null;

/** Return the intervals in which all requirements are met, by linear interpolation of the violations between samples. */
export function feasibleSpans(
  places: readonly number[],
  violations: readonly Violations[],
): Span[] {
  const spans: [number, number][] = [];
  for (let i = 0; i + 1 < violations.length; i++) {
    const span = metBetween(violations[i], violations[i + 1]);
    if (!span) continue;
    const [from, to] = span.map((share) => places[i] + share * (places[i + 1] - places[i]));
    const last = spans.at(-1);
    if (last?.[1] === from) last[1] = to;
    else spans.push([from, to]);
  }
  return spans;
}

/** Return the feasible part of an interval between two samples; half of it next to an invalid design. */
function metBetween(left: Violations, right: Violations): Span | null {
  if (!left || !right || left.length !== right.length) {
    const isMet = [left, right].map((violations) => violations?.every((m) => m <= 0));
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
