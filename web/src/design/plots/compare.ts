import { h, svg, write } from "../../shared/dom";
import type { DesignSummary } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { dashes, type Drawn } from "./charts";

const COLUMNS: [
  title: string,
  unit: string,
  value: (f: DesignSummary) => string,
  meaning?: string,
][] = [
  ["Field", "°", (f) => `${words(f.field_deg[0])} – ${words(f.field_deg[1], 5)}`],
  [
    "Rim radius",
    "px",
    (f) =>
      `${words(f.rim_radius_px)}${f.rim_radius_px > f.imager_radius_px + 0.02 ? ` > ${words(f.imager_radius_px)}` : ""}`,
  ],
  [
    "Resolution",
    "px/°",
    (f) => `${words(f.resolution_px_per_deg[0], 3)} – ${words(f.resolution_px_per_deg[1], 3)}`,
  ],
  [
    "Maximum blur",
    "px",
    (f) => words(f.worst_blur_px, 3),
    "Largest tangential or sagittal blur over the field from geometrical optics; Total blur also contains the Airy disc of the lens",
  ],
  ["Floored area", "deg²", (f) => words(f.worst_floored_area_deg2, 3)],
  ["Focus", "mm", (f) => words(f.focus_mm)],
  [
    "Depth of field",
    "mm",
    (f) => `${words(f.depth_of_field_mm[0])} – ${words(f.depth_of_field_mm[1] ?? Infinity)}`,
  ],
  ["Viewpoint", "mm", (f) => words(f.viewpoint_spread_mm, 3)],
  ["Length", "mm", (f) => words(f.length_mm)],
];

/** Actions of a pinned design. */
export interface PinCallbacks {
  take: (index: number) => void;
  drop: (index: number) => void;
}

/** Table of the current and the pinned designs; also the legend of all plots. */
export class CompareTable {
  readonly element: HTMLElement;
  private readonly body = h("tbody", {});
  private rows: Row[] = [];

  constructor(private readonly callbacks: PinCallbacks) {
    const head = h(
      "tr",
      {},
      h("th", { scope: "col" }, "Design"),
      h("td", {}),
      ...COLUMNS.map(([title, unit, , meaning]) =>
        h("th", { scope: "col", title: meaning ?? "" }, title, h("small", {}, unit)),
      ),
    );
    this.element = h(
      "div",
      { className: "compare", tabIndex: 0, role: "region", "aria-label": "Designs compared" },
      h("table", {}, h("thead", {}, head), this.body),
    );
  }

  /** Display the designs; rows are reused, so that their buttons keep the focus. */
  show(drawn: Drawn[]): void {
    if (drawn.length !== this.rows.length) {
      this.rows = drawn.map((_, i) => new Row(i, this.callbacks));
      this.body.replaceChildren(...this.rows.map((row) => row.element));
    }
    this.rows.forEach((row, i) => row.show(drawn[i]));
  }
}

/** One design: line style, name, actions if it is pinned, and values. */
class Row {
  readonly element: HTMLTableRowElement;
  private readonly name = h("th", { scope: "row" });
  private readonly values = COLUMNS.map(() => h("td", {}, ""));
  private readonly buttons: HTMLButtonElement[];
  private shown = "";

  constructor(index: number, callbacks: PinCallbacks) {
    const take = h(
      "button",
      { type: "button", title: "Load this design", onclick: () => callbacks.take(index - 1) },
      "Load",
    );
    const drop = h(
      "button",
      { type: "button", title: "Unpin", onclick: () => callbacks.drop(index - 1) },
      "×",
    );
    this.buttons = index ? [take, drop] : [];
    this.element = h("tr", {}, this.name, h("td", {}, ...this.buttons), ...this.values);
  }

  show(d: Drawn): void {
    const shown = `${d.dots} ${d.ink} ${d.name}`;
    if (shown !== this.shown) this.introduce(d);
    this.shown = shown;
    COLUMNS.forEach(([, , value], i) => write(this.values[i], value(d.evaluation.summary!)));
  }

  private introduce(d: Drawn): void {
    const line = svg("line", {
      x1: 0,
      x2: 34,
      y1: 4,
      y2: 4,
      stroke: d.ink,
      "stroke-width": d.dots ? 2 : 3,
      "stroke-dasharray": dashes(d.dots)?.join(" ") ?? "none",
    });
    const swatch = svg(
      "svg",
      { class: "swatch", viewBox: "0 0 34 8", "aria-hidden": "true" },
      line,
    );
    this.name.title = d.name;
    this.name.replaceChildren(
      swatch,
      ...(d.dots
        ? [h("small", { className: "number", style: `color: ${d.ink}` }, String(d.dots))]
        : []),
      d.name,
    );
    this.buttons.forEach((button, i) =>
      button.setAttribute("aria-label", `${["Load", "Unpin"][i]} ${d.name}`),
    );
  }
}
