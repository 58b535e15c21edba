import { clamp, wrapped } from "./numbers";

export const MODES = ["panorama", "perspective", "dome", "planet", "ground", "mosaic"] as const;
export type Mode = (typeof MODES)[number];
export const LOOKS = ["up", "down", "forward"] as const;
export type Looks = (typeof LOOKS)[number];
export const TABS = ["look", "design", "calibrate"] as const;

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
export const RANGES = { pan: [-Infinity, Infinity], tilt: [-90, 90], hfov: [2, 160], zoom: [1, 20], distance: [100, 1e6], height: [10, 1e5], forward: [-360, 360], pitch: [-90, 90], roll: [-180, 180] } as const;

/** The state with every number in its range, and no finer than the command line tells it. */
export function limited(s: State): State {
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

/** What of two states is not the same. */
export const differing = (a: State, b: State): Set<keyof State> => new Set((Object.keys(a) as (keyof State)[]).filter((k) => String(a[k]) !== String(b[k])));
