import {
  FITS,
  INITIAL,
  limited,
  CAMERA_ORIENTATIONS,
  MODES,
  RANGES,
  type State,
  TABS,
  viewsIn,
} from "./state";

/** Return the fragment of the address with the state that differs from the default; "" if there is none. */
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

/** Parse the state of an address. Invalid entries are ignored and reported. */
export function fromHash(hash: string): { state: State; error: string | null } {
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
    if (value === undefined) wrong.push(`${key} must be ${valid}; got ${text.slice(0, 40)}`);
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
    const valid = low === -Infinity ? "a number" : `between ${low} and ${high}`;
    take(key, (text) => (text.trim() && isGood(Number(text)) ? Number(text) : undefined), valid);
  }
  take("tab", oneOf(TABS), `one of ${TABS.join(", ")}`);
  take("mode", oneOf(MODES), `one of ${MODES.join(", ")}`);
  take("looks", oneOf(CAMERA_ORIENTATIONS), `one of ${CAMERA_ORIENTATIONS.join(", ")}`);
  take("fit", oneOf(FITS), `one of ${FITS.join(", ")}`);
  for (const key of ["flipped", "beside", "all"] as const)
    take(key, (text) => ({ true: true, false: false })[text], "true or false");
  take("views", (text) => (viewsIn(text) ? text : undefined), "views of a link");
  take("rim", circle, "u,v,radius in px");
  for (const key of ["design", "errors", "source", "sensor"] as const)
    s[key] = parts.get(key) || s[key];
  const error = wrong.length
    ? `Ignored invalid entries of the address: ${wrong.join("; ")}.`
    : null;
  return { state: limited(s), error };
}

function circle(text: string): [number, number, number] | undefined {
  const numbers = text.split(",").map(Number);
  return numbers.length === 3 && numbers.every(Number.isFinite) && numbers[2] > 0
    ? (numbers as [number, number, number])
    : undefined;
}
