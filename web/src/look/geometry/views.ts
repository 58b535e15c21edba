import { clamp, wrapped } from "../../shared/numbers";
import type { State } from "../../shared/state";
import { type Camera, STEPS_IN_SPACE } from "./camera";
import {
  dot,
  panTiltDirection,
  panTiltOf,
  type Pixel,
  RAD,
  sum,
  times,
  type Vec3,
  viewAxes,
} from "../../shared/vectors";

/** Types of screens, numbered as in the shader. */
export const SHAPES = { panorama: 0, plane: 1, polar: 2, planet: 3, ground: 4 } as const;

/** Screen and its position in the view; `numbers` is the uniform of the shader. */
export interface Part {
  left: number;
  top: number;
  width: number;
  height: number;
  shape: (typeof SHAPES)[keyof typeof SHAPES];
  axes: [Vec3, Vec3, Vec3];
  numbers: [number, number, number, number];
  /** mm; 0 for infinity */
  distance: number;
  isPoint: boolean;
}

export interface View {
  width: number;
  height: number;
  parts: Part[];
}

const MAX_PLANET_DEG = 270;
const PLAN_HEIGHTS = 4;
const MOSAIC_VIEWS = 4;

const rounded4 = (x: number): number => Math.round(x * 1e4) / 1e4;

/** Return the aspect ratio of a panorama of the complete field. */
function wholeAspect({ model: { tilt_min_deg: low, tilt_max_deg: high } }: Camera): number {
  return 360 / (high - low);
}

/** Return the vertical range of a panorama in degrees: complete, or reduced to fill the area. */
function heightOf(s: State, camera: Camera, aspect: number): number {
  const all = 360 / wholeAspect(camera);
  return (s.fit === "fill" ? Math.min(all, 360 / aspect) : all) / s.zoom;
}

/** Return the range of elevations of a panorama, degrees, after zoom and tilt. */
export function elevations(s: State, camera: Camera, aspect: number): [number, number] {
  const { tilt_min_deg: low, tilt_max_deg: high } = camera.model;
  const half = heightOf(s, camera, aspect) / 2;
  const middle = isAllHigh(s, camera, aspect)
    ? (low + high) / 2
    : clamp(s.tilt, low + half, high - half);
  return [Math.max(-90, rounded4(middle - half)), Math.min(90, rounded4(middle + half))];
}

/** Return true if a panorama displays the complete range of elevations. */
export const isAllHigh = (s: State, camera: Camera, aspect: number): boolean =>
  heightOf(s, camera, aspect) > 360 / wholeAspect(camera) - 1e-9;

/** Return the horizontal range of a panorama, degrees. */
export const spanOf = (s: State, camera: Camera, aspect: number): number =>
  rounded4(s.fit === "fill" ? heightOf(s, camera, aspect) * aspect : 360 / s.zoom);

/** Return the angle from the pole to the boundary of a dome, degrees. */
export function domeEnd(s: State, camera: Camera): number {
  return Math.min(180, rounded4(poleEnd(camera) / s.zoom));
}

/** Return the horizontal angle of a little planet, degrees; its longer side contains the complete field. */
export function planetWidth(s: State, camera: Camera, aspect: number): number {
  const maxValue = Math.min(2 * poleEnd(camera), MAX_PLANET_DEG);
  return rounded4(
    (4 * Math.atan((Math.tan((maxValue * RAD) / 4) / s.zoom) * Math.min(1, aspect))) / RAD,
  );
}

/** Return the scale of the ground plan, mm per pixel. */
export function groundScale(s: State, width: number, height: number): number {
  const side = s.fit === "fill" ? Math.max(width, height) : Math.min(width, height);
  const scale = (PLAN_HEIGHTS * s.height) / s.zoom / side;
  return Number(scale.toPrecision(8));
}

function poleEnd(camera: Camera): number {
  const { pole, tilt_min_deg, tilt_max_deg } = camera.model;
  return pole === "zenith" ? 90 - tilt_min_deg : 90 + tilt_max_deg;
}

/** Return the aspect ratio of the view type; null for any. */
export function aspectOf(s: State, camera: Camera): number | null {
  if (s.mode === "mosaic") return 1 / (1 / wholeAspect(camera) + 3 / 4 / MOSAIC_VIEWS);
  if (s.mode === "dome") return 1; // circular, cropped if the area is wider
  if (s.mode === "perspective" || s.fit === "fill") return null;
  return s.mode === "panorama" ? wholeAspect(camera) : 1;
}

/** Return the view of a state with a given size in pixels. The height of a mosaic follows from its width. */
export function viewOf(s: State, camera: Camera, width: number, height: number): View {
  const distance = Number.isFinite(s.distance) ? s.distance : 0;
  const box = { left: 0, top: 0, width, height };
  switch (s.mode) {
    case "panorama":
      return whole(width, height, {
        ...box,
        ...panorama(
          s.pan,
          spanOf(s, camera, width / height),
          elevations(s, camera, width / height),
          distance,
        ),
      });
    case "perspective":
      return whole(width, height, { ...box, ...plane(s.pan, s.tilt, s.hfov, width, distance) });
    case "dome": {
      const perPixel = (domeEnd(s, camera) * RAD) / (Math.min(width, height) / 2);
      const numbers: Part["numbers"] = [perPixel, Math.min(width, height) / 2, 0, 0];
      return whole(width, height, {
        ...box,
        ...polar(SHAPES.polar, s.pan, camera, numbers, distance),
      });
    }
    case "planet": {
      const perPixel = Math.tan((planetWidth(s, camera, width / height) * RAD) / 4) / (width / 2);
      return whole(width, height, {
        ...box,
        ...polar(SHAPES.planet, s.pan, camera, [perPixel, 0, 0, 0], distance),
      });
    }
    case "ground": {
      const axes = viewAxes(s.pan, -90);
      const numbers: Part["numbers"] = [groundScale(s, width, height), s.height, 0, 0];
      return whole(width, height, {
        ...box,
        shape: SHAPES.ground,
        axes,
        numbers,
        distance: 0,
        isPoint: true,
      });
    }
    case "mosaic":
      return mosaic(s, camera, width, distance);
  }
}

function whole(width: number, height: number, part: Part): View {
  return { width, height, parts: [part] };
}

type Shape = Omit<Part, "left" | "top" | "width" | "height">;

function panorama(
  pan: number,
  span: number,
  [low, high]: [number, number],
  distance: number,
): Shape {
  const numbers: Part["numbers"] = [pan * RAD, span * RAD, low * RAD, high * RAD];
  return { shape: SHAPES.panorama, axes: viewAxes(0, 0), numbers, distance, isPoint: distance > 0 };
}

function plane(pan: number, tilt: number, hfov: number, width: number, distance: number): Shape {
  const focal = width / 2 / Math.tan((hfov * RAD) / 2);
  return {
    shape: SHAPES.plane,
    axes: viewAxes(pan, tilt),
    numbers: [focal, 0, 0, 0],
    distance,
    isPoint: distance > 0,
  };
}

/** Return the axes of a view of the nadir, or of the zenith from the opposite side; forward is at the top in both. */
function polar(
  shape: Part["shape"],
  pan: number,
  camera: Camera,
  numbers: Part["numbers"],
  distance: number,
): Shape {
  const axes = camera.model.pole === "nadir" ? viewAxes(pan, -90) : viewAxes(pan + 180, 90);
  return { shape, axes, numbers, distance, isPoint: distance > 0 };
}

/** Round half to even, like Python. */
function rounded(x: number): number {
  const near = Math.round(x);
  return Math.abs(x % 1) === 0.5 && near % 2 ? near - 1 : near;
}

/** Return a mosaic: a panorama, rotated by 45 degrees, above four perspective views of its quarters. */
function mosaic(s: State, camera: Camera, width: number, distance: number): View {
  const side = Math.max(1, rounded(width / MOSAIC_VIEWS));
  const under = Math.max(1, rounded((side * 3) / 4));
  const { tilt_min_deg: low, tilt_max_deg: high } = camera.model;
  const over = Math.max(1, rounded((MOSAIC_VIEWS * side * (high - low)) / 360));
  const parts: Part[] = [
    {
      left: 0,
      top: 0,
      width: MOSAIC_VIEWS * side,
      height: over,
      ...panorama(s.pan + 45, 360, [low, high], 0),
    },
  ];
  [-90, 0, 90, 180].forEach((pan, i) => {
    const box = { left: i * side, top: over, width: side, height: under };
    parts.push({ ...box, ...plane(s.pan + pan, s.tilt, s.hfov, side, distance) });
  });
  return { width: MOSAIC_VIEWS * side, height: over + under, parts };
}

/** Return the target of a pixel of a view: point in mm or direction; null outside. */
export function targetIn(view: View, u: number, v: number): Vec3 | null {
  const part = partAt(view, u, v);
  return part ? targetAt(part, u - part.left, v - part.top) : null;
}

/** Return the image pixel displayed at a pixel of a view; null outside. */
export function pixelIn(view: View, camera: Camera, u: number, v: number): Pixel | null {
  const part = partAt(view, u, v);
  return part ? pixelAt(camera, part, u - part.left, v - part.top) : null;
}

/** Return the image pixel displayed at a pixel of a part; null outside. */
export function pixelAt(camera: Camera, part: Part, u: number, v: number): Pixel | null {
  const target = targetAt(part, u, v);
  const projection = target && camera.project(target, part.isPoint);
  return projection?.visible ? projection.pixel : null;
}

const partAt = (view: View, u: number, v: number): Part | undefined =>
  view.parts.find((p) => u >= p.left && v >= p.top && u < p.left + p.width && v < p.top + p.height);

/** Return the target of a pixel of a part: point in mm or direction; null outside. */
export function targetAt(part: Part, u: number, v: number): Vec3 | null {
  const [a, b, c, d] = part.numbers;
  const [forward, right, down] = part.axes;
  const [x, y] = [u - (part.width - 1) / 2, v - (part.height - 1) / 2];
  const far = part.distance || 1;
  const along = (f: number, r: number, g: number): Vec3 =>
    sum(times(f * far, forward), times(r * far, right), times(g * far, down));
  switch (part.shape) {
    case SHAPES.panorama: {
      const pan = a + ((u + 0.5) / part.width - 0.5) * b;
      const tilt = d - ((v + 0.5) / part.height) * (d - c);
      return times(part.distance ? far / Math.cos(tilt) : 1, panTiltDirection(pan, tilt));
    }
    case SHAPES.plane:
      return along(1, x / a, y / a);
    case SHAPES.polar: {
      const radius = Math.hypot(x, y);
      if (radius > b + 0.5) return null;
      const omega = radius * a;
      const k = radius > 0 ? Math.sin(omega) / radius : a;
      return along(Math.cos(omega), k * x, k * y);
    }
    case SHAPES.planet: {
      const t = Math.hypot(x, y) * a;
      const k = (2 * a) / (1 + t * t);
      return along(Math.cos(2 * Math.atan(t)), k * x, k * y);
    }
    default:
      return sum([0, 0, -b], times(a * x, right), times(a * y, down));
  }
}

/** Return the pixel of a view at which an image pixel is displayed; null outside. */
export function positionOf(view: View, camera: Camera, pixel: Pixel): Pixel | null {
  const ray = camera.backproject(pixel);
  if (!ray) return null;
  for (const part of view.parts) {
    const position = positionIn(part, camera, ray);
    if (!position) continue;
    const [u, v] = position;
    const isInside = u >= -0.5 && v >= -0.5 && u < part.width - 0.5 && v < part.height - 0.5;
    if (isInside) return [part.left + u, part.top + v];
  }
  return null;
}

/** Return the pixel of a part at which the ray of an image pixel is displayed. Rays do not start at the origin: the direction of a near target differs from its ray, and fixed-point iteration determines this difference. */
function positionIn(part: Part, camera: Camera, ray: Vec3): Pixel | null {
  let position = positionAt(part, ray);
  let direction = ray;
  for (let i = 0; part.isPoint && i < STEPS_IN_SPACE; i++) {
    const target = position && targetAt(part, ...position);
    const reached = target && camera.backproject(camera.project(target, true).pixel);
    if (!reached) break; // beyond the field
    direction = sum(direction, ray, times(-1, reached));
    position = positionAt(part, direction);
  }
  return position;
}

/** Return the pixel of a part, possibly beyond its edges, of a target in a direction from the origin; null without one. */
function positionAt(part: Part, direction: Vec3): Pixel | null {
  const [a, b, c, d] = part.numbers;
  const [along, x, y] = part.axes.map((axis) => dot(direction, axis));
  const across = Math.hypot(x, y);
  const angle = Math.atan2(across, along);
  const scaled = (k: number): Pixel => [
    (part.width - 1) / 2 + k * x,
    (part.height - 1) / 2 + k * y,
  ];
  switch (part.shape) {
    case SHAPES.panorama: {
      const { pan, tilt } = panTiltOf(direction);
      const share = 0.5 + (wrapped(pan - a / RAD) * RAD) / b;
      return [share * part.width - 0.5, ((d - tilt * RAD) / (d - c)) * part.height - 0.5];
    }
    case SHAPES.plane:
      return along > 0 ? scaled(a / along) : null;
    case SHAPES.polar:
      return angle > (b + 0.5) * a ? null : scaled(across ? angle / a / across : 0);
    case SHAPES.planet:
      return scaled(across ? Math.tan(angle / 2) / a / across : 0);
    default:
      return along > 0 ? scaled(b / along / a) : null;
  }
}
