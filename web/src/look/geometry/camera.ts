import type { CameraInfo } from "../../shared/messages";
import { clamp } from "../../shared/numbers";
import { type Tilt, retilted } from "./tilt";
import { dot, type Vec3 } from "../../shared/vectors";
import { type Pixel, sum, times } from "./vectors";

/** Image circle: centre and radius, px. */
export interface Circle {
  u: number;
  v: number;
  radius: number;
}

const NEWTON_STEPS = 8;
export const STEPS_IN_SPACE = 8; // iterations; each reduces the error by about the mirror size over twice the distance
const NUDGE = 1e-5;

/** Camera from the same tables as the shader; its circle can be fitted to an image. */
export class Camera {
  readonly scale: number;

  constructor(
    readonly model: CameraInfo,
    readonly tables: Float32Array,
    readonly circle: Circle = circleOf(model),
    readonly size: readonly [number, number] = model.image_size,
  ) {
    this.scale = circle.radius / model.rim_radius_px;
  }

  /** Return the camera with another circle, in an image of another size. */
  fitted(circle: Circle, size: readonly [number, number]): Camera {
    return new Camera(this.model, this.tables, circle, size);
  }

  /** Return the camera with another tilt. */
  tilted(to: Tilt): Camera {
    const { mount, axis, right, down } = this.model;
    const from = { pitch: mount.pitch_deg, roll: mount.roll_deg };
    const [a, r, d] = [axis, right, down].map(
      (v) => [...retilted(v as Vec3, from, to)] as [number, number, number],
    );
    const stands = { ...mount, pitch_deg: to.pitch, roll_deg: to.roll };
    return new Camera(
      { ...this.model, mount: stands, axis: a, right: r, down: d },
      this.tables,
      this.circle,
      this.size,
    );
  }

  get isMoved(): boolean {
    const own = circleOf(this.model);
    const { u, v, radius } = this.circle;
    const moved =
      Math.max(Math.abs(u - own.u), Math.abs(v - own.v), Math.abs(radius - own.radius)) > 1e-6;
    return (
      moved ||
      this.size[0] !== this.model.image_size[0] ||
      this.size[1] !== this.model.image_size[1]
    );
  }

  /** Project a direction, or a point in mm; beyond the field, return the boundary with `seen` false. */
  project(target: Vec3, isPoint = false): { pixel: Pixel; visible: boolean } {
    const t = this.model.tables;
    const [s, cos, sin] = this.place(target, isPoint);
    const end = t.lattice ? this.limit(Math.atan2(sin, cos)) : t.last;
    const inside = clamp(s, t.first, end);
    const pixel = this.pixelAt(inside * cos, inside * sin);
    const [w, h] = this.size;
    const isInImage =
      pixel[0] >= -0.5 && pixel[1] >= -0.5 && pixel[0] <= w - 0.5 && pixel[1] <= h - 0.5;
    return { pixel, visible: s >= t.first - 1e-6 && s <= end + 1e-6 && isInImage };
  }

  /** Return sin(Omega/2) of a target, and cosine and sine of its azimuth. */
  private place(target: Vec3, isPoint: boolean): Vec3 {
    const { axis, right, down, tables: t } = this.model;
    const visible: Vec3 = [dot(target, axis), dot(target, right), dot(target, down)];
    if (isPoint && t.starts) return this.solveInSpace(visible);
    const [s, cos, sin] = polar(visible);
    return [
      isPoint && t.origins ? this.solve(Math.hypot(visible[1], visible[2]), visible[0]) : s,
      cos,
      sin,
    ];
  }

  /** Back-project a pixel to a direction; null outside the field. */
  backproject([u, v]: Pixel): Vec3 | null {
    const { last } = this.model.tables;
    let x = ((u - this.circle.u) / this.circle.radius) * last;
    let y = ((v - this.circle.v) / this.circle.radius) * last;
    for (let step = 0; step < NEWTON_STEPS; step++) {
      const length = Math.hypot(x, y);
      if (length > last) [x, y] = [(x / length) * last, (y / length) * last];
      const [p, px, py] = [
        this.pixelAt(x, y),
        this.pixelAt(x + NUDGE, y),
        this.pixelAt(x, y + NUDGE),
      ];
      const [a, b, c, d] = [px[0] - p[0], py[0] - p[0], px[1] - p[1], py[1] - p[1]];
      const k = NUDGE / (a * d - b * c);
      const [eu, ev] = [u - p[0], v - p[1]];
      x += k * (d * eu - b * ev);
      y += k * (a * ev - c * eu);
    }
    const s = Math.hypot(x, y);
    const end = this.model.tables.lattice ? this.limit(Math.atan2(y, x)) : last;
    if (!(s <= end + 1e-6 && s >= this.model.tables.first - 1e-6)) return null;
    const cosine = Math.sqrt(Math.max(0, 1 - s * s));
    return sum(
      times(1 - 2 * s * s, this.model.axis),
      times(2 * cosine * x, this.model.right),
      times(2 * cosine * y, this.model.down),
    );
  }

  /** Return the pixel of a point of the disc sin(Omega/2) (cos, sin). */
  private pixelAt(x: number, y: number): Pixel {
    const own = circleOf(this.model);
    let du: number, dv: number;
    if (this.model.tables.lattice) {
      const [u, v] = this.latticeAt(x, y);
      [du, dv] = [u - own.u, v - own.v];
    } else {
      const s = Math.hypot(x, y);
      const r = s > 0 ? this.column(0, s) / s : 0;
      [du, dv] = [r * x, r * y];
    }
    return [this.circle.u + this.scale * du, this.circle.v + this.scale * dv];
  }

  /** Interpolate the radius, or a coordinate of the ray origin, in its table. */
  private column(which: 0 | 1 | 2, s: number): number {
    const { first, last, radii: n } = this.model.tables;
    const place = ((s - first) * (n - 1)) / (last - first);
    const cell = clamp(Math.floor(place), 0, n - 2);
    const [a, b] = [this.tables[which * n + cell], this.tables[which * n + cell + 1]];
    return a + (b - a) * (place - cell);
  }

  /** Interpolate the pixel lattice bilinearly, which is sufficient for overlays on the image. */
  private latticeAt(x: number, y: number): Pixel {
    const at = this.between(0, this.model.tables.lattice, 2, x, y);
    return [at(0), at(1)];
  }

  /** Interpolate component k of an n x n lattice at a point of the disc. */
  private between(
    from: number,
    n: number,
    components: number,
    x: number,
    y: number,
  ): (k: number) => number {
    const { last } = this.model.tables;
    const place = (a: number): number => ((a / last + 1) / 2) * (n - 1);
    const [i, j] = [x, y].map((a) => clamp(Math.floor(place(a)), 0, n - 2));
    const [fx, fy] = [place(x) - i, place(y) - j];
    const at = (di: number, dj: number, k: number): number =>
      this.tables[from + components * ((j + dj) * n + i + di) + k];
    return (k) =>
      (at(0, 0, k) * (1 - fx) + at(1, 0, k) * fx) * (1 - fy) +
      (at(0, 1, k) * (1 - fx) + at(1, 1, k) * fx) * fy;
  }

  private limit(phi: number): number {
    const { lattice, limits: n } = this.model.tables;
    const place = ((phi / (2 * Math.PI) + 1) % 1) * n;
    const from = 2 * lattice * lattice;
    const cell = Math.floor(place) % n;
    const [a, b] = [this.tables[from + cell], this.tables[from + ((cell + 1) % n)]];
    return a + (b - a) * (place - Math.floor(place));
  }

  /**
   * Return sin(Omega/2) of a point, including the ray origin, by Newton's method: the root of f(s) = s - sin(Omega(s)/2),
   * where Omega(s) is the angle of d = point - origin(s), and f'(s) = 1 - cos(Omega/2)/2 (dx z' - dz x') / |d|^2.
   */
  private solve(across: number, along: number): number {
    const t = this.model.tables;
    const step = (t.last - t.first) / (t.radii - 1);
    let s = clamp(halfSine(across, along - t.viewpoint_mm), t.first, t.last);
    for (let i = 0; i < NEWTON_STEPS; i++) {
      const low = clamp(s, t.first, t.last - step);
      const [x, z] = [this.column(1, s), this.column(2, s)];
      const [dx, dz] = [across - x, along - z];
      const rateX = (this.column(1, low + step) - this.column(1, low)) / step;
      const rateZ = (this.column(2, low + step) - this.column(2, low)) / step;
      const rate = 1 - (0.5 * halfCosine(dx, dz) * (dx * rateZ - dz * rateX)) / (dx * dx + dz * dz);
      s = clamp(s - (s - halfSine(dx, dz)) / rate, 2 * t.first - t.last, 2 * t.last - t.first);
    }
    return s;
  }

  /** Return sin(Omega/2) and azimuth of a point without rotational symmetry, by fixed-point iteration of the ray origin. */
  private solveInSpace([along, right, down]: Vec3): Vec3 {
    const { last, lattice, limits, starts } = this.model.tables;
    let estimate: Vec3 = [0, 1, 0];
    for (let i = 0; i < STEPS_IN_SPACE; i++) {
      const [s, cos, sin] = estimate;
      const inside = Math.min(s, last);
      const start = this.between(
        2 * lattice * lattice + limits,
        starts,
        3,
        inside * cos,
        inside * sin,
      );
      estimate = polar([along - start(0), right - start(1), down - start(2)]);
    }
    return estimate;
  }
}

/** Return the nominal circle of a camera. */
export function circleOf(model: CameraInfo): Circle {
  return { u: model.centre_px[0], v: model.centre_px[1], radius: model.rim_radius_px };
}

/** Return sin(Omega/2), and cosine and sine of the azimuth, of a vector (axis, right, down). */
function polar([along, right, down]: Vec3): Vec3 {
  const across = Math.hypot(right, down);
  const [cos, sin] = across > 0 ? [right / across, down / across] : [1, 0];
  return [halfSine(across, along), cos, sin];
}

/**
 * Return the sine of half the angle a to the axis without cancellation: the larger of sin(a/2) and cos(a/2) follows from
 * the sum (1 + |cos a|)/2, and the smaller one from sin a = 2 sin(a/2) cos(a/2).
 */
function halfSine(across: number, along: number): number {
  const length = Math.hypot(across, along) || 1;
  const more = Math.sqrt((length + Math.abs(along)) / (2 * length));
  const less = Math.abs(across) / (2 * length * more);
  if (across < 0) return along > 0 ? -less : 2 - more;
  return along > 0 ? less : more;
}

function halfCosine(across: number, along: number): number {
  const length = Math.hypot(across, along) || 1;
  const more = Math.sqrt((length + Math.abs(along)) / (2 * length));
  return along > 0 ? more : Math.abs(across) / (2 * length * more);
}
