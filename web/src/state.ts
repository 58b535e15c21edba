import { clamp, wrapped } from "./model/vectors";

export const MODES = ["panorama", "perspective", "dome", "planet", "ground", "mosaic"] as const;
export type Mode = (typeof MODES)[number];
export type Looks = "up" | "down" | "forward";

/** Everything that says what is seen. It lives in the address: a link or a reload brings it back. */
export interface State {
  /** What is looked at: "" nothing, "room" the demo, "kept" a file of the browser's, "webcam:.." a camera, "server:.." a source there. */
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
  tab: "look" | "design";
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
  tab: "look",
  design: "",
};

type Listener = (state: State, changed: Set<keyof State>) => void;

/** The one state of the page, and who wants to know of it. */
export class Store {
  private listeners: Listener[] = [];
  private pending = 0;

  constructor(public state: State = fromHash(location.hash)) {}

  listen(listener: Listener): void {
    this.listeners.push(listener);
  }

  set(change: Partial<State>): void {
    const next = limited({ ...this.state, ...change });
    const keys = (Object.keys(next) as (keyof State)[]).filter((k) => next[k] !== this.state[k]);
    if (!keys.length) return;
    this.state = next;
    for (const listener of this.listeners) listener(next, new Set(keys));
    clearTimeout(this.pending); // browsers limit how often an address may change
    this.pending = window.setTimeout(() => history.replaceState(null, "", toHash(this.state)), 150);
  }
}

/** The state with every number in its range, and no finer than the command line tells it. */
function limited(s: State): State {
  const round = (x: number): number => Math.round(x * 1e4) / 1e4;
  return {
    ...s,
    pan: round(wrapped(s.pan)),
    tilt: round(clamp(s.tilt, -90, 90)),
    hfov: round(clamp(s.hfov, 2, 160)),
    zoom: round(clamp(s.zoom, 1, 20)),
    distance: s.distance === Infinity ? Infinity : round(clamp(s.distance, 100, 1e6)),
    height: round(clamp(s.height, 10, 1e5)),
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
  return text ? `#${text}` : location.pathname + location.search;
}

export function fromHash(hash: string): State {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const s: State = { ...INITIAL };
  const number = (key: "pan" | "tilt" | "hfov" | "zoom" | "distance" | "height" | "forward"): void => {
    const x = Number(parts.get(key) ?? NaN);
    if (!Number.isNaN(x)) s[key] = x;
  };
  (["pan", "tilt", "hfov", "zoom", "distance", "height", "forward"] as const).forEach(number);
  s.tab = parts.get("tab") === "design" ? "design" : "look";
  s.design = parts.get("design") ?? s.design;
  s.source = parts.get("source") ?? s.source;
  s.sensor = parts.get("sensor") ?? s.sensor;
  const mode = parts.get("mode") as Mode | null;
  if (mode && MODES.includes(mode)) s.mode = mode;
  const looks = parts.get("looks");
  if (looks === "up" || looks === "down" || looks === "forward") s.looks = looks;
  const flipped = parts.get("flipped");
  if (flipped) s.flipped = flipped === "true";
  const rim = parts.get("rim")?.split(",").map(Number);
  if (rim?.length === 3 && rim.every(Number.isFinite) && rim[2] > 0) s.rim = rim as [number, number, number];
  return limited(s);
}
