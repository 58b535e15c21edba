import uPlot from "uplot";
import { colour, h, reveal, save } from "../../shared/dom";
import { fixed, words } from "../../shared/numbers";
import type { Evaluation, Table } from "../evaluation";
import { type Cursor, interpolated } from "./cursor";
import { csvOf, svgOf } from "./export";
import type { Chart } from "./quantities";

/** Axes of a chart: conversion between values and pixels of its overlay. */
export interface Area {
  layer: HTMLElement;
  left: number;
  top: number;
  width: number;
  height: number;
  across: (omega: number) => number;
  down: (value: number) => number;
  value: (down: number) => number;
  /** Move the cursor of the chart to a pointer captured by another element. */
  read: (e: MouseEvent) => void;
}

/** Draggable overlay of a chart. */
export interface Over {
  /** Whether it is dragged; the scale is then fixed. */
  readonly isHeld: boolean;
  /** Values to include in the range if they are close to the curves. */
  reach: () => number[];
  /** Place the overlay at the current curve; null if differences are plotted. */
  layOut: (area: Area, first: Curves | null) => void;
}

/** Plotted design: colour, name and evaluation. */
export interface Drawn {
  name: string;
  ink: string;
  /** Number of dots between the dashes of its lines; 0: solid. */
  dots: number;
  evaluation: Evaluation;
}

/** Curves of a design, one per column; if differences are plotted, the current design minus this one. */
export interface Curves {
  of: Drawn;
  omega: Float32Array;
  values: Float32Array[];
  /** Image heights, px, and the maximum image radius. */
  heights: Float32Array;
  rim: number;
}

const HEIGHT = 164;
const [DASH, DOT, GAP, WIDE_GAP] = [12, 2, 2.5, 6]; // px
const AXIS_FONT = "11px system-ui, sans-serif";
const FIELD_ANGLE = "Field angle Ω, °";
const LABEL = { labelFont: AXIS_FONT, labelSize: 15, labelGap: 0 };
const STEP_DEG = 1;
const POINT = 0.1; // excluded central part, relative to the maximum image radius; there, a degree of azimuth has no length
const STEEP = 4; // ratio to the spread above which central values are excluded from the scale
const SAME = 4e-6; // relative difference below which values are equal within single precision
const REACH = 1; // distance of included limits from the curves, relative to their spread

/** Chart of all designs. */
export class ChartView {
  readonly element: HTMLElement;
  private readonly readout = h("output", { className: "readout" });
  private readonly place = h("div", { className: "chart", tabIndex: 0 });
  private readonly layer = h("div", { className: "over" }, this.place);
  private plot: uPlot | null = null;
  private drawn: Drawn[] = [];
  private curves: Curves[] = [];
  private isDifference = false;
  private shape = "";
  private range: [number, number] = [0, 1];
  private resting: string | null = null;

  constructor(
    readonly chart: Chart,
    private readonly cursor: Cursor,
    private readonly overs: readonly Over[] = [],
  ) {
    const title = chart.unit ? `${chart.title}, ${chart.unit}` : chart.title;
    this.element = h(
      "figure",
      { className: "plot" },
      h(
        "figcaption",
        { title: `${chart.title}: ${chart.hint}` },
        h("span", {}, title),
        files(chart.title, (kind) => this.save(kind)),
      ),
      this.readout,
      this.layer,
    );
    this.place.setAttribute("role", "img");
    this.place.setAttribute("aria-label", `${chart.title} against field angle`);
    cursor.listen((omega, from) => this.point(omega, from));
    this.place.addEventListener("keydown", (e) => this.key(e));
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(this.place);
  }

  /** Draw designs, or the differences between the first and the others. */
  show(drawn: Drawn[], isDifference: boolean): void {
    this.drawn = drawn.filter((d) => this.table(d));
    if (!this.drawn.length) return;
    this.isDifference = isDifference && this.drawn.length > 1;
    this.curves = this.isDifference ? this.differences() : this.drawn.map((d) => this.curvesOf(d));
    const shape = `${this.drawn.map((d) => d.ink).join()} ${this.isDifference}`;
    const data = this.data();
    if (!this.overs.some((over) => over.isHeld)) this.range = this.reaching(this.spread());
    if (this.plot && shape === this.shape) this.plot.setData(data);
    else {
      this.plot?.destroy();
      this.plot = new uPlot(this.options(), data, this.place);
      this.shape = shape;
    }
    revealFiles(this.element);
    if (this.layer.matches(":hover")) this.read(this.cursor.omega);
    else this.point(this.cursor.omega, null);
  }

  /** Set the accessible description. */
  describe(): void {
    const [first] = this.curves;
    if (!first) return;
    const { omega, values } = first;
    const last = omega.length - 1;
    const parts = this.chart.columns.map(
      ({ symbol }, i) =>
        `${symbol} from ${words(values[i][0])} at ${words(omega[0])}° to ${words(values[i][last])} at ${words(omega[last])}°`,
    );
    this.place.setAttribute(
      "aria-label",
      `${this.isDifference ? "Difference of " : ""}${this.chart.title} against field angle${this.chart.unit ? ` in ${this.chart.unit}` : ""}: ${parts.join("; ")}. Arrow keys read values.`,
    );
  }

  private data(): uPlot.AlignedData {
    const tables = this.bottomUp().map(({ omega, values }): uPlot.AlignedData => [
      Array.from(omega),
      ...values.map((column) => Array.from(column, (v) => (Number.isFinite(v) ? v : null))),
    ]);
    return tables.length === 1 ? tables[0] : uPlot.join(tables);
  }

  /** Return the range of values, without those next to a pointed apex. */
  private spread(): [number, number] {
    const all: [number, number] = [Infinity, -Infinity];
    const outside: [number, number] = [Infinity, -Infinity];
    const maximum = this.upperLimit();
    for (const { values, heights, rim } of this.curves) {
      for (const column of values) {
        column.forEach((v, i) => {
          if (!Number.isFinite(v) || !(heights[i] >= 0) || v > maximum) return;
          for (const range of heights[i] >= POINT * rim ? [all, outside] : [all]) {
            if (v < range[0]) range[0] = v;
            if (v > range[1]) range[1] = v;
          }
        });
      }
    }
    const isSteep = all[1] - all[0] > STEEP * (outside[1] - outside[0]) && outside[1] > outside[0];
    const range = isSteep ? outside : all;
    return Number.isFinite(range[0]) ? range : [0, 1];
  }

  /** Return the upper limit of the plotted range for a quantity with poles: a multiple of the median. */
  private upperLimit(): number {
    if (this.chart.reach === Infinity) return Infinity;
    const values = this.curves
      .flatMap((curve) => curve.values.flatMap((column) => [...column]))
      .filter(Number.isFinite)
      .sort((a, b) => a - b);
    return this.chart.reach * (values[values.length >> 1] ?? Infinity);
  }

  /** Return the range including overlays that are close to the curves. */
  private reaching([low, high]: [number, number]): [number, number] {
    if (this.isDifference) return this.isSame ? [-this.maximum(), this.maximum()] : [low, high];
    const room = REACH * (high - low || Math.abs(high));
    const near = this.overs
      .flatMap((over) => over.reach())
      .filter((v) => v >= low - room && v <= high + room);
    return [Math.min(low, ...near), Math.max(high, ...near)];
  }

  /** Return true if the current and the pinned designs are equal within rounding. */
  private get isSame(): boolean {
    const [low, high] = this.spread();
    return this.isDifference && Math.max(-low, high) <= SAME * this.maximum();
  }

  /** Return the maximum magnitude of the current design; 1 if there are no values. */
  private maximum(): number {
    const values = this.curvesOf(this.drawn[0]).values.flatMap((column) =>
      Array.from(column, Math.abs),
    );
    return Math.max(0, ...values.filter(Number.isFinite)) || 1;
  }

  private options(): uPlot.Options {
    const series = this.bottomUp().flatMap(({ of: d }) =>
      this.chart.columns.map(({ dashed }): uPlot.Series => ({
        stroke: d.ink,
        width: d === this.drawn[0] ? 2 : 1.4,
        dash: dashes(d.dots, dashed),
        spanGaps: true,
        points: { show: false },
      })),
    );
    const axis = {
      stroke: colour("soft"),
      font: AXIS_FONT,
      grid: { stroke: colour("line"), width: 1 },
      ticks: { show: false },
    };
    const degrees = (_: uPlot, splits: number[]): string[] => splits.map((v) => `${v}°`);
    const numbers = (_: uPlot, splits: number[]): string[] =>
      splits.map((v) => String(+v.toPrecision(6)).replace("-", "−"));
    return {
      ...this.size(),
      padding: [8, 15, 0, 0],
      legend: { show: false },
      scales: {
        x: { time: false },
        y: {
          range: () =>
            uPlot.rangeNum(...this.range, {
              min: { pad: 0.06, soft: 0, mode: 2 },
              max: { pad: 0.06, soft: 0, mode: 2 },
            }),
        },
      },
      axes: [
        {
          ...axis,
          ...LABEL,
          label: FIELD_ANGLE,
          size: 22,
          gap: 3,
          values: degrees,
          space: 34,
          incrs: [5, 10, 15, 30, 45, 90],
        },
        { ...axis, ...LABEL, label: this.axisLabel, size: 46, gap: 4, values: numbers, space: 20 },
      ],
      series: [{}, ...series],
      cursor: { y: false, points: { size: 6 }, drag: { x: false, y: false } },
      hooks: {
        setCursor: [(u) => this.moved(u)],
        draw: [(u) => this.label(u), (u) => this.layOut(u)],
      },
    };
  }

  /** Label of the vertical axis: symbols and unit. */
  private get axisLabel(): string {
    const { columns, unit } = this.chart;
    const symbols = columns.map((c) => c.symbol).join(" · ");
    return `${this.isDifference ? "Difference of " : ""}${symbols}${unit && `, ${unit}`}`;
  }

  /** Return the curves in drawing order: pinned designs first, so that the current one is drawn on top. */
  private bottomUp(): Curves[] {
    return [...this.curves].reverse();
  }

  private curvesOf(d: Drawn): Curves {
    const table = this.table(d)!;
    return {
      of: d,
      omega: table.column("omega_deg"),
      values: this.chart.columns.map(({ name }) => table.column(name)),
      heights: d.evaluation.block("curves")!.column("h_px"),
      rim: d.evaluation.summary!.rim_radius_px,
    };
  }

  private differences(): Curves[] {
    const [own, ...additional] = this.drawn.map((d) => this.curvesOf(d));
    return additional.map((other) => ({
      ...own,
      of: other.of,
      values: own.values.map((column, k) =>
        column.map((value, i) => value - interpolated(other.omega, other.values[k], own.omega[i])),
      ),
    }));
  }

  /** Label each pinned design at the end of its curve, and a zero difference by a line. */
  private label(u: uPlot): void {
    const { ctx } = u;
    const dots = devicePixelRatio;
    ctx.save();
    ctx.setLineDash([]);
    if (this.isDifference) {
      const y = Math.round(u.valToPos(0, "y", true)) + 0.5;
      ctx.strokeStyle = colour("soft");
      ctx.lineWidth = dots;
      ctx.beginPath();
      ctx.moveTo(u.bbox.left, y);
      ctx.lineTo(u.bbox.left + u.bbox.width, y);
      ctx.stroke();
    }
    ctx.font = `600 ${11 * dots}px system-ui, sans-serif`;
    ctx.textAlign = "right";
    for (const { of: d, omega, values } of this.curves) {
      if (!d.dots) continue;
      const at = omega.length - 1 - Math.round((omega.length / 12) * d.dots);
      const [x, y] = [u.valToPos(omega[at], "x", true), u.valToPos(values[0][at], "y", true)];
      if (!(y > u.bbox.top && y < u.bbox.top + u.bbox.height)) continue;
      ctx.lineWidth = 4 * dots;
      ctx.strokeStyle = colour("panel");
      ctx.fillStyle = d.ink;
      ctx.strokeText(String(d.dots), x, y - 4 * dots);
      ctx.fillText(String(d.dots), x, y - 4 * dots);
    }
    ctx.restore();
  }

  private layOut(u: uPlot): void {
    const [left, top, width, height] = [u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height].map(
      (dots) => dots / uPlot.pxRatio,
    );
    const area: Area = {
      ...{ layer: this.layer, left, top, width, height },
      across: (omega) => left + u.valToPos(omega, "x"),
      down: (value) => top + u.valToPos(value, "y"),
      value: (down) => u.posToVal(down - top, "y"),
      read: (e) => u.over.dispatchEvent(new MouseEvent("mousemove", e)),
    };
    for (const over of this.overs)
      over.layOut(area, this.isDifference ? null : (this.curves[0] ?? null));
  }

  /** Return the values of a design in the chart; null if there are none. */
  private table({ evaluation }: Drawn): Table | null {
    const { block, columns } = this.chart;
    const names = evaluation.blocks.find((b) => b.name === block)?.columns ?? [];
    return columns.every((c) => names.includes(c.name)) ? evaluation.block(block) : null;
  }

  private save(kind: "svg" | "csv"): void {
    const { title, unit, columns } = this.chart;
    const text =
      kind === "csv"
        ? csvOf(
            columns.map((c) => c.name),
            this.curves.map((c) => ({
              name: this.nameOf(c),
              rows: Array.from(c.omega, (omega, i) => [
                omega,
                ...c.values.map((column) => column[i]),
              ]),
            })),
          )
        : this.svg(title, unit);
    save(
      new Blob([text], { type: kind === "csv" ? "text/csv" : "image/svg+xml" }),
      `${title.toLowerCase().replaceAll(" ", "-")}${this.isDifference ? "-difference" : ""}.${kind}`,
    );
  }

  private svg(title: string, unit: string): string {
    const lines = this.curves.flatMap((c) =>
      this.chart.columns.map(({ symbol, dashed }, k) => ({
        name: this.chart.columns.length > 1 ? `${this.nameOf(c)}, ${symbol}` : this.nameOf(c),
        ink: c.of.ink,
        dash: dashes(c.of.dots, dashed),
        x: c.omega,
        y: c.values[k],
      })),
    );
    const { min, max } = this.plot!.scales.y;
    const heading = this.isDifference ? `Difference of ${title.toLowerCase()}` : title;
    return svgOf(heading, unit, [FIELD_ANGLE, this.axisLabel], lines, [min ?? 0, max ?? 1]);
  }

  private nameOf({ of: d }: Curves): string {
    return this.isDifference ? `${this.drawn[0].name} minus ${d.name}` : d.name;
  }

  private moved(u: uPlot): void {
    if (!this.layer.matches(":hover")) return;
    const { left } = u.cursor;
    this.cursor.set(
      left === undefined || left === null || left < 0 ? null : u.posToVal(left, "x"),
      this,
    );
    if (this.cursor.omega !== null) this.read(this.cursor.omega);
  }

  private point(omega: number | null, from: unknown): void {
    this.read(omega);
    if (from === this || !this.plot) return;
    const left = omega === null ? -10 : this.plot.valToPos(omega, "x");
    this.plot.setCursor({ left, top: omega === null ? -10 : 1 }, false);
  }

  private read(omega: number | null): void {
    if (omega === null) return this.rest();
    this.resting = null;
    const spans = this.curves.map(({ of: d, omega: places, values }) => {
      const text = values.map((column) =>
        fixed(interpolated(places, column, omega), this.chart.places),
      );
      const span = h("b", {}, text.join(" · "));
      span.style.color = d.ink;
      return span;
    });
    this.readout.replaceChildren(`${omega.toFixed(1)}°  `, ...spans.flatMap((span) => [span, " "]));
    this.readout.title = this.readout.textContent ?? "";
  }

  /** Display the default readout, if it is not displayed already. */
  private rest(): void {
    const note = this.note();
    if (note !== this.resting)
      this.readout.replaceChildren(h("span", { className: "quiet" }, note));
    this.resting = note;
  }

  /** Return the legend, which is displayed without a cursor. */
  private note(): string {
    const { columns } = this.chart;
    const lines =
      columns.length > 1 ? columns.map((c) => `${c.symbol} ${c.dashed ? "dashed" : "solid"}`) : [];
    const what = this.isSame
      ? ["identical to the pinned design"]
      : this.isDifference
        ? ["current minus pinned"]
        : [];
    return [...what, ...lines].join(", ");
  }

  private key(e: KeyboardEvent): void {
    const step = { ArrowRight: STEP_DEG, ArrowLeft: -STEP_DEG }[e.key];
    const omega = this.curves[0]?.omega;
    if (!step || !omega) return;
    e.preventDefault();
    const [low, high] = [omega[0], omega[omega.length - 1]];
    const next = Math.min(high, Math.max(low, (this.cursor.omega ?? (low + high) / 2) + step));
    this.cursor.set(next, this.place);
  }

  private size(): { width: number; height: number } {
    return {
      width: Math.max(120, this.place.clientWidth),
      height: this.place.clientHeight || HEIGHT,
    };
  }
}

/** Return the dash pattern of a design, which distinguishes it without colour; dashed columns have wide gaps. */
export function dashes(dots: number, isDashed = false): number[] | undefined {
  const gap = isDashed ? WIDE_GAP : GAP;
  if (!dots) return isDashed ? [6, 4] : undefined;
  return [DASH, gap, ...Array.from({ length: dots }, () => [DOT, gap]).flat()];
}

/** Create the buttons that save a plot; hidden until {@link revealFiles}. */
export function files(
  title: string,
  saved: (kind: "svg" | "csv") => void,
  kinds: readonly ("svg" | "csv")[] = ["svg", "csv"],
): HTMLElement {
  return h(
    "span",
    { className: "files", hidden: true },
    ...kinds.map((kind) =>
      h(
        "button",
        {
          type: "button",
          "aria-label": `Save ${title} as ${kind.toUpperCase()}`,
          title: `Save as ${kind.toUpperCase()}`,
          onclick: () => saved(kind),
        },
        kind.toUpperCase(),
      ),
    ),
  );
}

/** Show the buttons of a plot, which has values now. */
export function revealFiles(plot: HTMLElement): void {
  reveal(plot.querySelector<HTMLElement>(".files")!, true);
}
