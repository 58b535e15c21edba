import { clamp, wrapped } from "./model/vectors";

export const MODES = ["panorama", "perspective", "dome", "planet", "ground", "mosaic"] as const;
export type Mode = (typeof MODES)[number];
const LOOKS = ["up", "down", "forward"] as const;
export type Looks = (typeof LOOKS)[number];
const TABS = ["look", "design"] as const;

/** Everything that says what is seen. It lives in the address: a link or a reload brings it back. */
export interface State {
  /** What is looked at: "" nothing, "room" the demo, "kept:.." a file of the browser's by its content, "webcam:.." a camera, "server:.." a source there. */
  source: string;
  sensor: string;
  mode: Mode;
  pan: number;
  tilt: number;
  /** Width of a perspective view, degrees. */
  hfov: number;
  /** How far a panorama, dome, planet or plan is enlarged. */
  zoom: number;
  /** Distance of the screen, mm; Infinity for far away. */
  distance: number;
  /** How high the mirror stands over the ground, mm. */
  height: number;
  /** Circle moved to fit the picture: centre and radius, px. */
  rim: [number, number, number] | null;
  looks: Looks | null;
  forward: number | null;
  flipped: boolean | null;
  /** How far the sensor leans, degrees; null as its file says. */
  pitch: number | null;
  roll: number | null;
  tab: (typeof TABS)[number];
  /** The design on the bench, as the bench writes it. */
  design: string;
}

export const INITIAL: State = {
  source: "",
  sensor: "paper-spherical",
  mode: "panorama",
  pan: 0,
  tilt: 0,
  hfov: 90,
  zoom: 1,
  distance: Infinity,
  height: 1200,
  rim: null,
  looks: null,
  forward: null,
  flipped: null,
  pitch: null,
  roll: null,
  tab: "look",
  design: "",
};

/** Numbers of the address, and from where to where they are taken; beyond, the nearest is. */
const RANGES = { pan: [-Infinity, Infinity], tilt: [-90, 90], hfov: [2, 160], zoom: [1, 20], distance: [100, 1e6], height: [10, 1e5], forward: [-360, 360], pitch: [-90, 90], roll: [-180, 180] } as const;

/** What makes another page of the browser's history; all else changes the page that is shown. */
const TURNS: readonly (keyof State)[] = ["tab", "mode", "source", "sensor"];
const WRITTEN_MS = 150; // browsers limit how often an address may change
const KEPT = "omnimirror-address";

type Listener = (state: State, changed: Set<keyof State>) => void;

/** The one state of the page, and who wants to know of it. */
export class Store {
  state: State;
  /** What of the address is not understood, in a sentence. */
  trouble: string | null;
  /** Who is told when another address was entered. */
  entered: () => void = () => {};
  /** What is done before the page is left. */
  leaving: () => void = () => {};
  private listeners: Listener[] = [];
  private pending = 0;
  private written = location.hash;

  constructor() {
    ({ state: this.state, trouble: this.trouble } = fromHash(beforeReload() ?? location.hash));
    for (const event of ["popstate", "hashchange"] as const) addEventListener(event, () => this.follow());
    addEventListener("pagehide", () => this.leave());
  }

  listen(listener: Listener): void {
    this.listeners.push(listener);
  }

  /** Change the state, and the address with it; `turns` is false for what nobody would go back from. */
  set(change: Partial<State>, turns = true): void {
    const next = limited({ ...this.state, ...change });
    const changed = differing(next, this.state);
    if (!changed.size) return;
    const isTurn = turns && TURNS.some((key) => changed.has(key));
    if (isTurn) this.write(); // where Back leads to is where it was left
    this.state = next;
    if (isTurn) this.write(true);
    this.tell(changed);
    clearTimeout(this.pending);
    this.pending = window.setTimeout(() => this.write(), WRITTEN_MS);
  }

  /** Go where the address leads: another link was entered, or Back or Forward pressed. */
  private follow(): void {
    if (location.hash === this.written) return;
    clearTimeout(this.pending);
    this.written = location.hash;
    const found = fromHash(location.hash);
    const next = { ...found.state, design: found.state.design || this.state.design };
    const changed = differing(next, this.state);
    this.state = next;
    this.trouble = found.trouble;
    this.entered();
    this.tell(changed);
  }

  private tell(changed: Set<keyof State>): void {
    for (const listener of this.listeners) listener(this.state, changed);
  }

  private write(isTurn = false): void {
    clearTimeout(this.pending);
    const text = toHash(this.state);
    const url = text || location.pathname + location.search;
    try {
      if (isTurn) history.pushState(null, "", url);
      else history.replaceState(null, "", url);
    } catch {
      return; // too often, for some browsers
    }
    this.written = location.hash;
  }

  /** A reload must find what was changed a moment ago. */
  private leave(): void {
    this.leaving();
    this.write();
    try {
      sessionStorage.setItem(KEPT, toHash(this.state));
    } catch {
      return; // private windows keep nothing
    }
  }
}

/** What the page was left with, where it is loaded anew; null where an address was entered. */
function beforeReload(): string | null {
  const [way] = performance.getEntriesByType("navigation") as PerformanceNavigationTiming[];
  try {
    return way?.type === "reload" ? sessionStorage.getItem(KEPT) : null;
  } catch {
    return null;
  }
}

const differing = (a: State, b: State): Set<keyof State> => new Set((Object.keys(a) as (keyof State)[]).filter((k) => String(a[k]) !== String(b[k])));

/** The state with every number in its range, and no finer than the command line tells it. */
function limited(s: State): State {
  const round = (x: number): number => Math.round(x * 1e4) / 1e4;
  const within = (key: keyof typeof RANGES, x: number): number => round(clamp(x, RANGES[key][0], RANGES[key][1]));
  return {
    ...s,
    pan: round(wrapped(s.pan)),
    tilt: within("tilt", s.tilt),
    hfov: within("hfov", s.hfov),
    zoom: within("zoom", s.zoom),
    distance: s.distance === Infinity ? Infinity : within("distance", s.distance),
    height: within("height", s.height),
  };
}

export function toHash(s: State): string {
  const parts = new URLSearchParams();
  for (const [key, value] of Object.entries(s)) {
    const own = INITIAL[key as keyof State];
    if (value === own || value === null || (key === "design" && s.tab === "look")) continue;
    parts.set(key, Array.isArray(value) ? value.map((x) => +x.toFixed(3)).join(",") : String(value));
  }
  const text = parts.toString();
  return text && `#${text}`;
}

/** The state of an address. Entries that are none are left out, and said. */
export function fromHash(hash: string): { state: State; trouble: string | null } {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const s: State = { ...INITIAL };
  const wrong: string[] = [];
  const take = <K extends keyof State>(key: K, read: (text: string) => State[K] | undefined, valid: string): void => {
    const text = parts.get(key);
    if (text === null) return;
    const value = read(text);
    if (value === undefined) wrong.push(`${key} = ${text.slice(0, 40)} (valid ${valid})`);
    else s[key] = value;
  };
  const oneOf = <T extends string>(all: readonly T[]) => (text: string): T | undefined => all.find((value) => value === text);
  for (const [key, [low, high]] of Object.entries(RANGES) as [keyof typeof RANGES, readonly [number, number]][]) {
    const endless = key === "distance";
    const isGood = (x: number): boolean => (Number.isFinite(x) && x >= low && x <= high) || (endless && x === Infinity);
    const valid = low === -Infinity ? "is a number" : `from ${low} to ${high}`;
    take(key, (text) => (text.trim() && isGood(Number(text)) ? Number(text) : undefined), valid);
  }
  take("tab", oneOf(TABS), `are ${TABS.join(", ")}`);
  take("mode", oneOf(MODES), `are ${MODES.join(", ")}`);
  take("looks", oneOf(LOOKS), `are ${LOOKS.join(", ")}`);
  take("flipped", (text) => ({ true: true, false: false })[text], "are true, false");
  take("rim", circle, "are a centre and a radius, px: u,v,radius");
  for (const key of ["design", "source", "sensor"] as const) s[key] = parts.get(key) || s[key];
  const trouble = wrong.length ? `In the address, what cannot be was left out: ${wrong.join("; ")}.` : null;
  return { state: limited(s), trouble };
}

function circle(text: string): [number, number, number] | undefined {
  const numbers = text.split(",").map(Number);
  return numbers.length === 3 && numbers.every(Number.isFinite) && numbers[2] > 0 ? (numbers as [number, number, number]) : undefined;
}
