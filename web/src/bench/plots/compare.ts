import { h, svg } from "../../shared/dom";
import type { Facts } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { dashes, type Drawn } from "./charts";

const COLUMNS: [title: string, unit: string, value: (f: Facts) => string][] = [
  ["Field", "°", (f) => `${words(f.field_deg[0])} – ${words(f.field_deg[1], 5)}`],
  ["Rim image", "px", (f) => `${words(f.rim_radius_px)}${f.rim_radius_px > f.imager_radius_px + 0.02 ? ` > ${words(f.imager_radius_px)}` : ""}`],
  ["Resolution", "px/°", (f) => `${words(f.resolution_px_per_deg[0], 3)} – ${words(f.resolution_px_per_deg[1], 3)}`],
  ["Worst blur", "px", (f) => words(f.worst_blur_px, 3)],
  ["Floored area", "deg²", (f) => words(f.worst_floored_area_deg2, 3)],
  ["Focus", "mm", (f) => words(f.focus_mm)],
  ["Depth of field", "mm", (f) => `${words(f.depth_of_field_mm[0])} – ${words(f.depth_of_field_mm[1] ?? Infinity)}`],
  ["Viewpoints", "mm", (f) => words(f.viewpoint_spread_mm, 3)],
  ["Length", "mm", (f) => words(f.length_mm)],
];

/** What can be done with a pinned design. */
export interface PinHands {
  take: (index: number) => void;
  drop: (index: number) => void;
}

/** The design in hand and the pinned ones, number by number: the legend of all plots. */
export class CompareTable {
  readonly element = h("div", { className: "compare", tabIndex: 0, role: "region", "aria-label": "Designs compared" });

  constructor(private readonly hands: PinHands) {}

  show(drawn: Drawn[]): void {
    const head = h("tr", {}, h("th", { scope: "col" }, "Design"), h("td", {}), ...COLUMNS.map(([title, unit]) => h("th", { scope: "col" }, title, h("small", {}, unit))));
    const rows = drawn.map((d, i) => h("tr", {}, this.name(d), h("td", {}, ...(i ? this.buttons(d, i - 1) : [])), ...COLUMNS.map(([, , value]) => h("td", {}, value(d.found.facts!)))));
    const held = document.activeElement instanceof HTMLElement && this.element.contains(document.activeElement);
    if (held) return this.refill(rows);
    this.element.replaceChildren(h("table", {}, h("thead", {}, head), h("tbody", {}, ...rows)));
  }

  /** New numbers, while a button in the table has the focus. */
  private refill(rows: HTMLTableRowElement[]): void {
    const old = this.element.querySelectorAll("tbody tr");
    if (old.length !== rows.length) return this.element.querySelector("tbody")!.replaceChildren(...rows);
    rows.forEach((row, i) => [...row.cells].forEach((cell, j) => j !== 1 && old[i].children[j].replaceWith(cell)));
  }

  private name(d: Drawn): HTMLElement {
    const line = svg("line", { x1: 0, x2: 34, y1: 4, y2: 4, stroke: d.ink, "stroke-width": d.dots ? 2 : 3, "stroke-dasharray": dashes(d.dots)?.join(" ") ?? "none" });
    const swatch = svg("svg", { class: "swatch", viewBox: "0 0 34 8", "aria-hidden": "true" }, line);
    return h("th", { scope: "row", title: d.name }, swatch, d.dots ? h("small", { className: "number", style: `color: ${d.ink}` }, String(d.dots)) : null, d.name);
  }

  private buttons(d: Drawn, index: number): HTMLElement[] {
    const take = h("button", { type: "button", title: "Put it on the bench", "aria-label": `Take ${d.name}`, onclick: () => this.hands.take(index) }, "Take");
    const drop = h("button", { type: "button", title: "Unpin", "aria-label": `Unpin ${d.name}`, onclick: () => this.hands.drop(index) }, "×");
    return [take, drop];
  }
}
