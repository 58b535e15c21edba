import uPlot from "uplot";
import { colour, h } from "../../shared/dom";
import type { QuantityOf } from "../../shared/messages";
import { fixed, words } from "../../shared/numbers";
import type { Found, Table } from "../answers";
import { explained, symbolOf, unitWords } from "../labels";
import { type Cursor, interpolated } from "./cursor";

/** One plot over the field angle: in which group, of which columns, with how many decimals. */
interface Plot {
  group: string;
  columns: string[];
  places: number;
  /** Where there is more than one column; the others are drawn dashed. */
  title?: string;
}

export const PLOTS: Plot[] = [
  { group: "Mapping", columns: ["h_px"], places: 1 },
  { group: "Mapping", columns: ["dh_domega_px_per_deg"], places: 3 },
  { group: "Viewpoints", columns: ["viewpoint_z_mm"], places: 2 },
  { group: "Area and aspect", columns: ["area_px2"], places: 2 },
  { group: "Area and aspect", columns: ["aspect"], places: 3 },
  { group: "Blur", columns: ["blur_t_px", "blur_s_px"], places: 2, title: "Blur in the image" },
  { group: "Blur", columns: ["blur_t_deg", "blur_s_deg"], places: 3, title: "Blur in angle" },
  { group: "Blur", columns: ["floored_area_deg2"], places: 3 },
];

/** A plot with the words of the vocabulary. */
interface Chart {
  title: string;
  group: string;
  unit: string;
  columns: { name: string; symbol: string; dashed: boolean }[];
  places: number;
  hint: string;
}

/** The plots, called as the vocabulary calls their columns. */
export const chartsOf = (vocabulary: QuantityOf[]): Chart[] =>
  PLOTS.map(({ group, columns, places, title }) => {
    const quantities = columns.map((name) => vocabulary.find((q) => q.name === name)!);
    const named = quantities.map((q, i) => ({ name: q.name, symbol: symbolOf(q), dashed: i > 0 }));
    return { title: title ?? quantities[0].title, group, unit: unitWords(quantities[0].unit), columns: named, places, hint: quantities.map(explained).join("; ") };
  });

/** A design that is drawn: its colour, its name, what was found. */
export interface Drawn {
  name: string;
  ink: string;
  /** How many dots its lines have between their dashes; 0: they are drawn through. */
  dots: number;
  found: Found;
}

const HEIGHT = 164;
const [DASH, DOT, GAP, WIDE_GAP] = [12, 2, 2.5, 6]; // px
const AXIS_FONT = "11px system-ui, sans-serif";
const STEP_DEG = 1;
const POINT = 0.1; // of the image radius: about the point of a mirror, where a degree of azimuth shrinks to nothing
const STEEP = 4; // values there that are so many times as spread do not set the scale

/** One chart with all designs in it. */
export class ChartView {
  readonly element: HTMLElement;
  private readonly readout = h("output", { className: "readout" });
  private readonly place = h("div", { className: "chart", tabIndex: 0 });
  private plot: uPlot | null = null;
  private drawn: Drawn[] = [];
  private shape = "";
  private range: [number, number] = [0, 1];

  constructor(readonly chart: Chart, private readonly cursor: Cursor) {
    const title = chart.unit ? `${chart.title}, ${chart.unit}` : chart.title;
    this.element = h("figure", { className: "plot" }, h("figcaption", { title: `${chart.title}: ${chart.hint}` }, h("span", {}, title), chart.columns.length > 1 ? h("span", { className: "quiet" }, chart.columns.map((c) => `${c.symbol} ${c.dashed ? "dashed" : "through"}`).join(", ")) : null), this.readout, this.place);
    this.place.setAttribute("role", "img");
    this.place.setAttribute("aria-label", `${chart.title} against field angle`);
    cursor.listen((omega, from) => this.point(omega, from));
    this.place.addEventListener("keydown", (e) => this.key(e));
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(this.place);
  }

  show(drawn: Drawn[]): void {
    this.drawn = drawn;
    const shape = drawn.map((d) => d.ink).join();
    const data = this.data();
    this.range = this.spread();
    if (this.plot && shape === this.shape) this.plot.setData(data);
    else {
      this.plot?.destroy();
      this.plot = new uPlot(this.options(), data, this.place);
      this.shape = shape;
    }
    if (this.place.matches(":hover")) this.read(this.cursor.omega);
    else this.point(this.cursor.omega, null);
  }

  /** Say what is drawn to who does not see it. */
  describe(): void {
    const [first] = this.drawn;
    const table = first && curves(first);
    if (!table) return;
    const omega = table.column("omega_deg");
    const parts = this.chart.columns.map(({ name, symbol }) => `${symbol} from ${words(table.column(name)[0])} at ${words(omega[0])}° to ${words(table.column(name)[table.rows - 1])} at ${words(omega[table.rows - 1])}°`);
    this.place.setAttribute("aria-label", `${this.chart.title} against field angle${this.chart.unit ? ` in ${this.chart.unit}` : ""}: ${parts.join("; ")}. Arrow keys read values.`);
  }

  private data(): uPlot.AlignedData {
    const tables: uPlot.AlignedData[] = [];
    for (const d of this.bottomUp()) {
      const table = curves(d)!;
      const x = Array.from(table.column("omega_deg"));
      tables.push([x, ...this.chart.columns.map(({ name }) => Array.from(table.column(name), (v) => (Number.isFinite(v) ? v : null)))]);
    }
    return tables.length === 1 ? tables[0] : uPlot.join(tables);
  }

  /** Lowest and highest value, without what only the point of a mirror has. */
  private spread(): [number, number] {
    const of = (share: number): [number, number] => {
      const values = this.drawn.flatMap((d) => {
        const [table, least] = [curves(d)!, share * d.found.facts!.rim_radius_px];
        const heights = table.column("h_px");
        return this.chart.columns.flatMap(({ name }) => Array.from(table.column(name)).filter((v, i) => Number.isFinite(v) && heights[i] >= least));
      });
      return [Math.min(...values), Math.max(...values)];
    };
    const [all, outside] = [of(0), of(POINT)];
    const isSteep = all[1] - all[0] > STEEP * (outside[1] - outside[0]) && outside[1] > outside[0];
    return isSteep ? outside : all;
  }

  private options(): uPlot.Options {
    const series = this.bottomUp().flatMap((d) =>
      this.chart.columns.map(({ dashed }): uPlot.Series => ({ stroke: d.ink, width: d === this.drawn[0] ? 2 : 1.4, dash: dashes(d.dots, dashed), spanGaps: true, points: { show: false } })),
    );
    const axis = { stroke: colour("soft"), font: AXIS_FONT, grid: { stroke: colour("line"), width: 1 }, ticks: { show: false } };
    const degrees = (_: uPlot, splits: number[]): string[] => splits.map((v) => `${v}°`);
    const numbers = (_: uPlot, splits: number[]): string[] => splits.map((v) => String(+v.toPrecision(6)).replace("-", "−"));
    return {
      ...this.size(),
      padding: [8, 15, 0, 0],
      legend: { show: false },
      scales: { x: { time: false }, y: { range: () => uPlot.rangeNum(...this.range, { min: { pad: 0.06, soft: 0, mode: 2 }, max: { pad: 0.06, soft: 0, mode: 2 } }) } },
      axes: [
        { ...axis, size: 26, gap: 4, values: degrees, space: 34, incrs: [5, 10, 15, 30, 45, 90] },
        { ...axis, size: 48, gap: 4, values: numbers, space: 26 },
      ],
      series: [{}, ...series],
      cursor: { y: false, points: { size: 6 }, drag: { x: false, y: false } },
      hooks: { setCursor: [(u) => this.moved(u)] },
    };
  }

  /** Pinned designs first, so that the one in hand is drawn over them. */
  private bottomUp(): Drawn[] {
    return [...this.drawn].reverse();
  }

  private moved(u: uPlot): void {
    if (!this.place.matches(":hover")) return;
    const { left } = u.cursor;
    this.cursor.set(left === undefined || left === null || left < 0 ? null : u.posToVal(left, "x"), this);
    if (this.cursor.omega !== null) this.read(this.cursor.omega);
  }

  private point(omega: number | null, from: unknown): void {
    this.read(omega);
    if (from === this || !this.plot) return;
    const left = omega === null ? -10 : this.plot.valToPos(omega, "x");
    this.plot.setCursor({ left, top: omega === null ? -10 : 1 }, false);
  }

  private read(omega: number | null): void {
    if (omega === null) return this.readout.replaceChildren();
    const values = this.drawn.map((d) => {
      const table = curves(d)!;
      const text = this.chart.columns.map(({ name }) => fixed(interpolated(table.column("omega_deg"), table.column(name), omega), this.chart.places));
      const span = h("b", {}, text.join(" · "));
      span.style.color = d.ink;
      return span;
    });
    this.readout.replaceChildren(`${omega.toFixed(1)}°  `, ...values.flatMap((v) => [v, " "]));
    this.readout.title = this.readout.textContent ?? "";
  }

  private key(e: KeyboardEvent): void {
    const step = { ArrowRight: STEP_DEG, ArrowLeft: -STEP_DEG }[e.key];
    const table = this.drawn[0] && curves(this.drawn[0]);
    if (!step || !table) return;
    e.preventDefault();
    const omega = table.column("omega_deg");
    const [low, high] = [omega[0], omega[table.rows - 1]];
    const next = Math.min(high, Math.max(low, (this.cursor.omega ?? (low + high) / 2) + step));
    this.cursor.set(next, this.place);
  }

  private size(): { width: number; height: number } {
    return { width: Math.max(120, this.place.clientWidth), height: this.place.clientHeight || HEIGHT };
  }
}

/** The line of a design, told from others without its colour; what is dashed has wide gaps. */
export function dashes(dots: number, isDashed = false): number[] | undefined {
  const gap = isDashed ? WIDE_GAP : GAP;
  if (!dots) return isDashed ? [6, 4] : undefined;
  return [DASH, gap, ...Array.from({ length: dots }, () => [DOT, gap]).flat()];
}

const curves = (d: Drawn): Table | null => d.found.block("curves");
