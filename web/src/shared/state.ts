import { clamp, wrapped } from "./numbers";
import { parsed } from "./storage";

export const MODES = ["panorama", "perspective", "dome", "planet", "ground", "mosaic"] as const;
export type Mode = (typeof MODES)[number];
export const CAMERA_ORIENTATIONS = ["up", "down", "forward"] as const;
export type CameraOrientation = (typeof CAMERA_ORIENTATIONS)[number];
export const TABS = ["look", "design", "calibrate"] as const;
export const FITS = ["whole", "fill"] as const;

/** Complete state of the view, stored in the address. */
export interface State {
  /** Source: "" none, "room" the demo, "kept:..." a stored file by content, "webcam:..." a webcam, "server:..." a source of the server. */
  source: string;
  sensor: string;
  mode: Mode;
  pan: number;
  tilt: number;
  /** Horizontal field of view of a perspective view, degrees. */
  hfov: number;
  /** Zoom factor of a panorama, dome, planet or plan. */
  zoom: number;
  /** Display the complete view or fill the area; null: depending on the size of the page. */
  fit: (typeof FITS)[number] | null;
  /** Whether the raw image is displayed next to the view. */
  beside: boolean;
  /** Stored views, parsed by {@link viewsIn}. */
  views: string;
  /** Index of the active view if all are displayed; -1: none. */
  view: number;
  /** Whether all stored views are displayed. */
  all: boolean;
  /** Divider between original and restored image, relative to the width; null: original only. */
  wipe: number | null;
  /** Distance of the screen, mm; Infinity for distant objects. */
  distance: number;
  /** Height of the mirror above the ground, mm. */
  height: number;
  /** Circle fitted to the image: centre and radius, px. */
  rim: [number, number, number] | null;
  looks: CameraOrientation | null;
  forward: number | null;
  flipped: boolean | null;
  /** Tilt of the sensor, degrees; null: as in its file. */
  pitch: number | null;
  roll: number | null;
  tab: (typeof TABS)[number];
  /** Design, encoded by the Design tab. */
  design: string;
  /** Errors of the design, encoded by the Design tab; "" for none. */
  errors: string;
}

export const INITIAL: State = {
  source: "",
  sensor: "paper-spherical",
  mode: "panorama",
  pan: 0,
  tilt: 0,
  hfov: 90,
  zoom: 1,
  fit: null,
  beside: false,
  views: "",
  view: -1,
  all: false,
  wipe: null,
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
  errors: "",
};

/** Ranges of numbers in the address; values outside are clamped. */
export const RANGES = {
  view: [-1, 15],
  wipe: [0, 1],
  pan: [-Infinity, Infinity],
  tilt: [-90, 90],
  hfov: [2, 160],
  zoom: [1, 20],
  distance: [100, 1e6],
  height: [10, 1e5],
  forward: [-360, 360],
  pitch: [-90, 90],
  roll: [-180, 180],
} as const;

/** Part of the state that defines a view. */
export const VIEW = ["mode", "pan", "tilt", "hfov", "zoom", "fit", "distance", "height"] as const;
type ViewOf = Pick<State, (typeof VIEW)[number]>;

/** Part of the state that defines image and camera. */
export const SOURCE_KEYS = [
  "source",
  "sensor",
  "rim",
  "looks",
  "forward",
  "flipped",
  "pitch",
  "roll",
] as const;
type ViewSource = Pick<State, (typeof SOURCE_KEYS)[number]>;

/** Stored view with its name. */
export interface StoredView extends ViewOf {
  name: string;
  /** Its image and camera, if there are several sources. */
  of?: ViewSource;
}

const MAX_VIEWS = 16;
export const MAX_NAME_LENGTH = 40;

/** Parse stored views; null if invalid. */
export function viewsIn(text: string): StoredView[] | null {
  const result = text ? parsed(text) : [];
  if (!Array.isArray(result) || result.length > MAX_VIEWS) return null;
  const views = result.map((entry) => viewIn(entry as Record<string, unknown> | null));
  return views.every((view) => view !== null) ? views : null;
}

function viewIn(entry: Record<string, unknown> | null): StoredView | null {
  if (typeof entry?.name !== "string" || !entry.name || entry.name.length > MAX_NAME_LENGTH)
    return null;
  const view = { ...INITIAL, ...entry } as StoredView & State;
  const isGood =
    MODES.includes(view.mode) &&
    (view.fit === null || FITS.includes(view.fit)) &&
    VIEW.every((key) => typeof view[key] !== "number" || !Number.isNaN(view[key]));
  const isKind =
    isGood && VIEW.every((key) => key === "fit" || typeof view[key] === typeof INITIAL[key]);
  const of =
    entry.of === undefined ? undefined : viewSourceIn(entry.of as Record<string, unknown> | null);
  return isKind && of !== null
    ? { name: entry.name, ...ofView(limited(view)), ...(of && { of }) }
    : null;
}

function viewSourceIn(entry: Record<string, unknown> | null): ViewSource | null {
  const of = { ...sourceOfState(INITIAL), ...entry };
  const isText = [of.source, of.sensor].every((text) => typeof text === "string" && text !== "");
  const isNumber = [of.forward, of.pitch, of.roll].every((x) => x === null || Number.isFinite(x));
  const isCircle =
    of.rim === null ||
    (Array.isArray(of.rim) &&
      of.rim.length === 3 &&
      of.rim.every(Number.isFinite) &&
      of.rim[2] > 0);
  const isWay =
    (of.looks === null || CAMERA_ORIENTATIONS.includes(of.looks)) &&
    (of.flipped === null || typeof of.flipped === "boolean");
  return entry && isText && isNumber && isCircle && isWay ? sourceOfState(of) : null;
}

/** Encode stored views without default values. */
export function textOf(views: readonly StoredView[]): string {
  const withoutDefaults = (entries: object): object =>
    Object.fromEntries(
      Object.entries(entries).filter(([key, value]) => value !== INITIAL[key as keyof State]),
    );
  const entry = ({ name, of, ...view }: StoredView): object => ({
    name: name.slice(0, MAX_NAME_LENGTH),
    ...withoutDefaults(view),
    ...(of && { of: { sensor: of.sensor, ...withoutDefaults(of) } }),
  });
  return views.length ? JSON.stringify(views.slice(0, MAX_VIEWS).map(entry)) : "";
}

export const sourceOfState = (s: ViewSource): ViewSource =>
  Object.fromEntries(SOURCE_KEYS.map((key) => [key, s[key]])) as unknown as ViewSource;
export const ofView = (s: ViewOf): ViewOf =>
  Object.fromEntries(VIEW.map((key) => [key, s[key]])) as unknown as ViewOf;

/** Return the state with all numbers clamped, and rounded to the precision of the command line. */
export function limited(s: State): State {
  const round = (x: number): number => Math.round(x * 1e4) / 1e4;
  const within = (key: keyof typeof RANGES, x: number): number =>
    round(clamp(x, RANGES[key][0], RANGES[key][1]));
  return {
    ...s,
    pan: round(wrapped(s.pan)),
    tilt: within("tilt", s.tilt),
    hfov: within("hfov", s.hfov),
    zoom: within("zoom", s.zoom),
    view: Math.round(within("view", s.view)),
    distance: s.distance === Infinity ? Infinity : within("distance", s.distance),
    height: within("height", s.height),
  };
}

/** Return the keys that differ between two states. */
export const differing = (a: State, b: State): Set<keyof State> =>
  new Set((Object.keys(a) as (keyof State)[]).filter((k) => String(a[k]) !== String(b[k])));
