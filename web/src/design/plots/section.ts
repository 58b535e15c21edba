import { h, save, svg } from "../../shared/dom";
import { roundUp, words } from "../../shared/numbers";
import type { EditCallbacks } from "../handles/handle";
import { ProfileHandles } from "../handles/profile";
import { blocksLike, type Table } from "../evaluation";
import { dashes, type Drawn, files, revealFiles } from "./charts";
import { type Cursor, interpolated } from "./cursor";
import { Drawing } from "./drawing";
import { standalone } from "./export";
import { Sizes } from "./sizes";

type Point = [number, number];

type Anchor = "start" | "middle" | "end";

/** Text of a drawing; `rows` is the number of positions that are tried from top to bottom. */
interface Label {
  at: Point;
  text: string;
  anchor: Anchor;
  rows?: number;
  class?: string;
}

/** Limits in mm along the axis (z, to the right) and perpendicular to it (x, up). */
interface Window {
  z: Point;
  x: Point;
}

const FAR_AWAY = 2.5; // maximum distance of drawn virtual images from the vertex, in rim radii
const [LABEL_GAP, LETTER, BESIDE] = [13, 7.5, 3]; // px, height of labels of 11 px
const LABEL_ROWS = 3;
const MIN_TICKS_PX = 44; // minimum distance of ticks
const CURVES: [name: string, label: string][] = [
  ["T∞", "T, ∞"],
  ["T5M", "T, 5 M"],
  ["S∞", "S, ∞"],
  ["S5M", "S, 5 M"],
];

const multiples = (step: number, low: number, high: number): number[] =>
  Array.from({ length: Math.max(0, Math.floor(high / step) - Math.ceil(low / step) + 1) }, (_, i) =>
    Number(((Math.ceil(low / step) + i) * step).toPrecision(6)),
  );

/** Cross-section of the sensor with the lens at the left: complete, and mirror with virtual images. */
export class SectionView {
  readonly element: HTMLElement;
  private readonly whole = svg("svg", {
    class: "section",
    role: "img",
    "aria-label": "Cross-section",
  });
  private readonly close = svg("svg", {
    class: "section",
    role: "img",
    "aria-label": "Virtual images",
  });
  private readonly readout = h("output", { className: "readout" });
  private readonly note = h("span", { className: "quiet" });
  private readonly overWhole = h("div", { className: "over" }, this.whole);
  private readonly pair = h("div", { className: "pair" }, this.overWhole, this.close);
  private readonly sizes: Sizes;
  private readonly handles: ProfileHandles | null;
  private drawn: Drawn[] = [];
  private window: Window | null = null;

  /** `bending` deforms the mirror interactively; null if not available. */
  constructor(
    private readonly cursor: Cursor,
    curveEditing: EditCallbacks | null,
  ) {
    this.handles = curveEditing && new ProfileHandles(this.overWhole, curveEditing);
    this.element = h(
      "figure",
      { className: "plot wide" },
      h(
        "figcaption",
        {},
        h("span", {}, "Cross-section"),
        this.note,
        files("the cross-section", () => this.save(), ["svg"]),
      ),
      this.readout,
      this.pair,
    );
    cursor.listen(() => this.drawCursor());
    for (const place of [this.whole, this.close])
      place.addEventListener("pointermove", (e) => this.moved(place, e));
    this.sizes = new Sizes([this.whole, this.close], true, () => this.draw());
  }

  show(drawn: Drawn[]): void {
    this.drawn = drawn.filter((d) => d.evaluation.block("mirror"));
    if (this.drawn.length) revealFiles(this.element);
    this.draw();
  }

  describe(): void {
    const [first] = this.drawn;
    if (!first) return;
    const f = first.evaluation.summary!;
    const [near, far] = f.depth_of_field_mm;
    this.whole.setAttribute(
      "aria-label",
      `Cross-section: mirror with rim radius ${words(f.rim_radius_mm)} mm, lens at ${words(f.mirror_distance_mm)} mm, chief rays every 15° up to ${words(f.field_deg[1])}°.`,
    );
    this.close.setAttribute(
      "aria-label",
      `Tangential and sagittal virtual images of objects at infinity and at five rim radii. Depth of field ${words(near)} to ${words(far)} mm around ${words(f.focus_mm)} mm.`,
    );
  }

  private save(): void {
    save(new Blob([standalone(this.whole)], { type: "image/svg+xml" }), "cross-section.svg");
  }

  /** Set the cursor to the mirror point at the height of the pointer. */
  private moved(place: SVGElement, e: PointerEvent): void {
    const table = this.drawn[0]?.evaluation.block("curves");
    const x = Math.abs(
      framed.get(place)?.across(e.clientY - place.getBoundingClientRect().top) ?? NaN,
    );
    const omega = table ? interpolated(table.column("x_mm"), table.column("omega_deg"), x) : NaN;
    this.cursor.set(Number.isNaN(omega) ? null : omega, this);
  }

  private draw(): void {
    const [first] = this.drawn;
    if (!first) return;
    this.pair.classList.toggle("alone", !first.evaluation.block("focus"));
    this.drawWhole(first);
    this.drawClose(first);
    const [near, far] = first.evaluation.summary!.depth_of_field_mm;
    const note = `chief rays; virtual images (T, S) of objects at infinity and 5 rim radii (fine); depth of field ${words(near)} to ${words(far)} mm from the lens`;
    if (note !== this.note.textContent) this.note.textContent = note;
    this.drawCursor();
  }

  private drawWhole(first: Drawn): void {
    const M = first.evaluation.summary!.rim_radius_mm;
    const tables = this.drawn.flatMap((d) =>
      ["mirror", "secondary", "lens"].map((n) => d.evaluation.block(n)),
    );
    const [low, high] = extent(tables.flatMap((t) => (t ? [...t.column("z_mm")] : [])));
    const maxValue = Math.max(...this.drawn.map((d) => d.evaluation.summary!.rim_radius_mm));
    const band = first.evaluation.block("focus")?.column("z_mm");
    const top = Math.max(high, Math.min(band ? band[0] : high, FAR_AWAY * M));
    const isHeld = this.window !== null && this.handles?.isHeld; // the scale is fixed during a drag
    this.window = isHeld
      ? this.window!
      : { z: [low - 0.2 * M, top + 0.35 * M], x: [-1.25 * maxValue, 1.75 * maxValue] };
    const frame = new Frame(this.whole, this.sizes.of(this.whole), this.window);
    frame.axis();
    if (band) frame.band(band);
    for (const d of [...this.drawn].reverse()) {
      for (const ray of d === first ? blocksLike(d.evaluation, "ray ") : []) frame.ray(ray, d.ink);
      for (const name of ["mirror", "secondary"])
        frame.curve(d.evaluation.block(name), d.ink, d === first ? "solid" : "other", d.dots);
      frame.curve(d.evaluation.block("lens"), d.ink, "lens");
    }
    frame.scales();
    frame.end();
    this.handles?.layOut(frame, first.evaluation);
  }

  private drawClose(first: Drawn): void {
    const M = first.evaluation.summary!.rim_radius_mm;
    const images = CURVES.map(([name]) => first.evaluation.block(name));
    const band = first.evaluation.block("focus")?.column("z_mm");
    const hasImages = images.some(Boolean);
    this.close.style.display = hasImages ? "" : "none";
    if (!hasImages || !band) return;
    const heights = [
      ...images.flatMap((t) => (t ? [...t.column("z_mm")] : [])),
      ...first.evaluation.block("mirror")!.column("z_mm"),
      ...band,
    ];
    const [low, high] = extent(heights.filter((z) => Math.abs(z) < FAR_AWAY * M));
    const frame = new Frame(this.close, this.sizes.of(this.close), {
      z: [low - 0.1 * M, high + 0.18 * M],
      x: [-1.35 * M, 1.35 * M],
    });
    frame.axis();
    frame.band(band);
    for (const d of this.drawn.slice(1))
      frame.curve(d.evaluation.block("mirror"), d.ink, "other", d.dots);
    frame.curve(first.evaluation.block("mirror"), first.ink, "solid");
    for (const [name, text] of CURVES)
      frame.image(
        first.evaluation.block(name),
        first.ink,
        `${name[0] === "S" ? "dashed " : ""}${name.endsWith("M") ? "fine" : "strong"}`,
        text,
      );
    frame.scales();
    frame.end();
  }

  /** Draw the ray of the cursor with its virtual images. */
  private drawCursor(): void {
    for (const place of [this.whole, this.close]) place.querySelector(".read")?.remove();
    const { omega } = this.cursor;
    const [first] = this.drawn;
    const table = first?.evaluation.block("curves");
    if (omega === null || !table) return this.readout.replaceChildren();
    const at = (name: string): number =>
      interpolated(table.column("omega_deg"), table.column(name), omega);
    const [x, z] = [at("x_mm"), at("z_mm")];
    if (Number.isNaN(x)) return this.readout.replaceChildren();
    this.readout.replaceChildren(
      `${omega.toFixed(1)}°  `,
      h("b", {}, `x ${words(x)} mm, z ${words(z)} mm`),
    );
    framed.get(this.whole)?.read([z, x], omega);
    const frame = framed.get(this.close);
    for (const [name] of CURVES.filter(([n]) => n.endsWith("∞"))) {
      const image = first.evaluation.block(name);
      if (image)
        frame?.dot(
          image,
          (omega - table.column("omega_deg")[0]) /
            (table.column("omega_deg")[table.rows - 1] - table.column("omega_deg")[0]),
          name[0],
        );
    }
  }
}

const framed = new WeakMap<SVGElement, Frame>();
const drawings = new WeakMap<SVGElement, Drawing>();

/** Drawing to scale in an SVG, in its own pixels. */
class Frame {
  /** Pixels per mm. */
  readonly scale: number;
  private readonly origin: Point;
  private readonly width: number;
  private readonly height: number;
  private readonly drawing: Drawing;
  private readonly texts: Label[] = [];

  constructor(
    private readonly place: SVGElement,
    box: { width: number; height: number },
    private readonly window: Window,
  ) {
    this.width = Math.max(100, box.width);
    const [w, t] = [window.z[1] - window.z[0], window.x[1] - window.x[0]];
    this.height = Math.max(100, box.height);
    this.scale = Math.min(this.width / w, this.height / t);
    this.origin = [(this.width - w * this.scale) / 2, (this.height - t * this.scale) / 2];
    this.drawing = drawings.get(place) ?? new Drawing(place);
    this.drawing.begin(this.width, this.height);
    drawings.set(place, this.drawing);
    framed.set(place, this);
  }

  at([z, x]: Point): Point {
    return [
      this.origin[0] + (z - this.window.z[0]) * this.scale,
      this.height - this.origin[1] - (x - this.window.x[0]) * this.scale,
    ];
  }

  /** Return the distance from the axis of a height in the drawing, mm. */
  across(v: number): number {
    return this.window.x[0] + (this.height - this.origin[1] - v) / this.scale;
  }

  axis(): void {
    const [, y] = this.at([0, 0]);
    this.drawing.add("line", { class: "axis", x1: 0, x2: this.width, y1: y, y2: y });
  }

  /** Draw the scales along the lower and the left edge, mm. */
  scales(): void {
    const step = roundUp(MIN_TICKS_PX / this.scale);
    const [right, top] = [this.width, this.height];
    this.tick(right - 3, top - 8, "end", "z, mm");
    this.tick(3, 11, "start", "x, mm", LABEL_ROWS);
    for (const z of multiples(step, this.along(0), this.along(right))) {
      const [u] = this.at([z, 0]);
      this.drawing.add("line", { class: "tick", x1: u, x2: u, y1: top - 5, y2: top });
      if (u > 34 && u < right - 46) this.tick(u, top - 8, "middle", String(z));
    }
    for (const x of multiples(step, this.across(top), this.across(0))) {
      const [, v] = this.at([0, x]);
      this.drawing.add("line", { class: "tick", x1: 0, x2: 5, y1: v, y2: v });
      if (v > 22 && v < top - 22) this.tick(8, v + 4, "start", String(x));
    }
  }

  private tick(x: number, y: number, anchor: Anchor, text: string, rows = 1): void {
    this.texts.push({ at: [x, y], text: text.replace("-", "−"), anchor, rows, class: "tick" });
  }

  /** Return the position along the axis of a distance from the left edge, mm. */
  private along(u: number): number {
    return this.window.z[0] + (u - this.origin[0]) / this.scale;
  }

  band([focus, near, far]: Float32Array): void {
    const [from] = this.at([near, 0]);
    const [to] = this.at([Number.isFinite(far) ? far : 1e6, 0]);
    const [at] = this.at([focus, 0]);
    this.drawing.add("rect", {
      class: "band",
      x: from,
      y: 0,
      width: Math.max(0.5, Math.min(to, this.width) - from),
      height: this.height,
    });
    this.drawing.add("line", { class: "focus", x1: at, x2: at, y1: 0, y2: this.height });
  }

  curve(table: Table | null, ink: string, look: string, dots = 0): void {
    if (!table) return;
    const style: Record<string, string> = dots
      ? { "stroke-dasharray": dashes(dots)!.join(" ") }
      : {};
    this.drawing.add("path", { class: look, d: this.path(pointsOf(table)), stroke: ink, ...style });
  }

  image(table: Table | null, ink: string, look: string, text: string): void {
    if (!table) return;
    const points = pointsOf(table);
    this.drawing.add("path", { class: `image ${look}`, d: this.path(points), stroke: ink });
    this.drawing.add("path", {
      class: `image ${look}`,
      d: this.path(points.map(([z, x]): Point => [z, -x])),
      stroke: ink,
    });
    const shown = points.filter((p) => this.holds(this.at(p)));
    if (shown.length)
      this.texts.push({ at: this.at(shown[shown.length - 1]), text, anchor: "start" });
  }

  /** Draw a chief ray: from the edge of the drawing to the mirror and to the lens. */
  ray(table: Table, ink: string): void {
    const omega = Number(table.name.slice(4));
    const points = pointsOf(table);
    const end = this.edge(points[0], omega);
    this.drawing.add("path", { class: "ray", d: this.path([end, ...points]), stroke: ink });
    const [u, v] = this.at(end);
    this.texts.push({ at: [u, v < 4 ? 12 : v - 3], text: `${omega}°`, anchor: "middle" });
  }

  read(point: Point, omega: number): void {
    const [u, v] = this.at(point);
    const line = svg("path", { class: "read", d: this.path([this.edge(point, omega), point]) });
    const group = svg("g", { class: "read" }, line, svg("circle", { cx: u, cy: v, r: 3.5 }));
    this.place.append(group);
  }

  dot(table: Table, share: number, text: string): void {
    const points = pointsOf(table);
    const point = points[Math.round(share * (points.length - 1))];
    if (!point || !Number.isFinite(point[0])) return;
    const [u, v] = this.at(point);
    if (!this.holds([u, v])) return;
    let group = this.place.querySelector(".read");
    if (!group) this.place.append((group = svg("g", { class: "read" })));
    group.append(
      svg("circle", { cx: u, cy: v, r: 3.5 }),
      svg(
        "text",
        text === "T" ? { x: u - 6, y: v + 4, "text-anchor": "end" } : { x: u + 6, y: v + 4 },
        text,
      ),
    );
  }

  /** Draw texts last; shift overlapping ones, and omit those without space. */
  end(): void {
    const occupied: { left: number; right: number; v: number }[] = [];
    for (const { at, text, anchor, rows = LABEL_ROWS, class: kind = "" } of this.texts) {
      const [u, v] = [
        Math.min(Math.max(at[0], 2), this.width - 2),
        Math.min(Math.max(at[1], 11), this.height - 3),
      ];
      const width = LETTER * text.length;
      const left = Math.min(
        Math.max(2, u - { start: 0, middle: width / 2, end: width }[anchor]),
        this.width - 2 - width,
      );
      const isFree = (at: number): boolean =>
        !occupied.some(
          (t) =>
            left < t.right + BESIDE &&
            left + width > t.left - BESIDE &&
            Math.abs(at - t.v) < LABEL_GAP,
        );
      const row = Array.from({ length: rows }, (_, i) => v + i * LABEL_GAP).find(
        (at) => isFree(at) && at < this.height,
      );
      if (row === undefined) continue;
      occupied.push({ left, right: left + width, v: row });
      this.drawing.add(
        "text",
        { class: kind, x: left + width / 2, y: row, "text-anchor": "middle" },
        text,
      );
    }
    this.drawing.end();
  }

  /** Return the entry point of the ray from an object into the drawing. */
  private edge([z, x]: Point, omega: number): Point {
    const angle = (omega * Math.PI) / 180;
    const [dz, dx] = [-Math.cos(angle), Math.sin(angle)];
    const [left, bottom] = [this.window.z[0] - this.origin[0] / this.scale, this.window.x[0]];
    const [right, top] = [
      this.window.z[1] + this.origin[0] / this.scale,
      this.window.x[1] + this.origin[1] / this.scale,
    ];
    const along = [
      dz > 0 ? (right - z) / dz : dz < 0 ? (left - z) / dz : Infinity,
      dx > 0 ? (top - x) / dx : dx < 0 ? (bottom - x) / dx : Infinity,
    ];
    const t = Math.max(0, Math.min(...along));
    return [z + t * dz, x + t * dx];
  }

  private holds([u, v]: Point): boolean {
    return u >= 0 && v >= 0 && u <= this.width && v <= this.height;
  }

  private path(points: Point[]): string {
    let isDown = false;
    let d = "";
    for (const point of points) {
      const [u, v] = this.at(point);
      const is = Number.isFinite(u) && Number.isFinite(v) && Math.abs(u) < 1e5 && Math.abs(v) < 1e5;
      if (is) d += `${isDown ? "L" : "M"}${u.toFixed(1)} ${v.toFixed(1)}`;
      isDown = is;
    }
    return d;
  }
}

const pointsOf = (table: Table): Point[] => {
  const [z, x] = [table.column("z_mm"), table.column("x_mm")];
  return Array.from(z, (value, i): Point => [value, x[i]]);
};

const extent = (values: number[]): Point => {
  const finite = values.filter(Number.isFinite);
  return [Math.min(...finite), Math.max(...finite)];
};
