import { FITS, INITIAL, limited, LOOKS, MODES, RANGES, type State, TABS, viewsIn } from "./state";

/** The part of an address after its #, with what of the state is not as at first; "" where all is. */
export function toHash(s: State): string {
  const parts = new URLSearchParams();
  for (const [key, value] of Object.entries(s)) {
    const own = INITIAL[key as keyof State];
    if (
      value === own ||
      value === null ||
      ((key === "design" || key === "errors") && s.tab !== "design")
    )
      continue;
    parts.set(
      key,
      Array.isArray(value) ? value.map((x: number) => +x.toFixed(3)).join(",") : String(value),
    );
  }
  const text = parts.toString();
  return text && `#${text}`;
}

/** The state of an address. Entries that are none are left out, and said. */
export function fromHash(hash: string): { state: State; trouble: string | null } {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const s: State = { ...INITIAL };
  const wrong: string[] = [];
  const take = <K extends keyof State>(
    key: K,
    read: (text: string) => State[K] | undefined,
    valid: string,
  ): void => {
    const text = parts.get(key);
    if (text === null) return;
    const value = read(text);
    if (value === undefined) wrong.push(`${key} = ${text.slice(0, 40)} (valid ${valid})`);
    else s[key] = value;
  };
  const oneOf =
    <T extends string>(all: readonly T[]) =>
    (text: string): T | undefined =>
      all.find((value) => value === text);
  for (const [key, [low, high]] of Object.entries(RANGES) as [
    keyof typeof RANGES,
    readonly [number, number],
  ][]) {
    const endless = key === "distance";
    const isGood = (x: number): boolean =>
      (Number.isFinite(x) && x >= low && x <= high) || (endless && x === Infinity);
    const valid = low === -Infinity ? "is a number" : `from ${low} to ${high}`;
    take(key, (text) => (text.trim() && isGood(Number(text)) ? Number(text) : undefined), valid);
  }
  take("tab", oneOf(TABS), `are ${TABS.join(", ")}`);
  take("mode", oneOf(MODES), `are ${MODES.join(", ")}`);
  take("looks", oneOf(LOOKS), `are ${LOOKS.join(", ")}`);
  take("fit", oneOf(FITS), `are ${FITS.join(", ")}`);
  for (const key of ["flipped", "beside", "all"] as const)
    take(key, (text) => ({ true: true, false: false })[text], "are true, false");
  take("views", (text) => (viewsIn(text) ? text : undefined), "are views that this page keeps");
  take("rim", circle, "are a centre and a radius, px: u,v,radius");
  for (const key of ["design", "errors", "source", "sensor"] as const)
    s[key] = parts.get(key) || s[key];
  const trouble = wrong.length
    ? `In the address, what cannot be was left out: ${wrong.join("; ")}.`
    : null;
  return { state: limited(s), trouble };
}

function circle(text: string): [number, number, number] | undefined {
  const numbers = text.split(",").map(Number);
  return numbers.length === 3 && numbers.every(Number.isFinite) && numbers[2] > 0
    ? (numbers as [number, number, number])
    : undefined;
}
