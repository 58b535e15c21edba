import { colour, h, reveal, write } from "../../shared/dom";
import type { QuantityInfo } from "../../shared/messages";
import type { Found } from "../found";
import { type Design, nameOf, type Pin } from "../designs/design";
import { limitsOf } from "../designs/requirements";
import { glossary } from "../glossary";
import type { BendHands } from "../hands/handle";
import { type LimitHands, LimitLines, linesOf } from "../hands/limits";
import { MappingHandles } from "../hands/mapping";
import { labelledMessage } from "../labels";
import { alone } from "../supply";
import { ChartView, type Drawn } from "./charts";
import { CompareTable, type PinHands } from "./compare";
import { Cursor } from "./cursor";
import { PictureView } from "./picture";
import { type Chart, chartOf, chartsOf, PLOTS } from "./quantities";
import { SectionView } from "./section";
import { SpacePlot } from "./space";
import { SquaresView } from "./squares";

const INKS = ["accent", "pin1", "pin2", "pin3", "pin4"];
const DESCRIBED_MS = 400; // idle time after which descriptions of charts are updated

/** Groups of plots that can be hidden. */
const COMPUTED = ["3-D view", "Image"]; // computed by the server only
const LIMITS = "Limits"; // limited quantities without another plot
const GROUPS = [
  "3-D view",
  "Section",
  ...new Set(PLOTS.map((p) => p.group)),
  LIMITS,
  "Squares",
  "Image",
].filter((group) => !(alone && COMPUTED.includes(group)));
const CLOSED = ["3-D view", "Object size"]; // collapsed initially

/** Direct manipulation of the plots; not available in pages without a server. */
interface DeskHands extends PinHands {
  bending: BendHands;
  limits: LimitHands;
  /** Called if the set of displayed plots changes. */
  chosen: () => void;
}

/** Main area of the bench: table of designs and plots. */
export class Desk {
  readonly element: HTMLElement;
  /** Groups of plots that differ from the default. */
  switched: string[] = [];
  /** Whether differences to the pinned designs are plotted. */
  private isDifference = false;
  private readonly difference = h("input", { type: "checkbox", name: "Difference" });
  private readonly cursor = new Cursor();
  private readonly compare: CompareTable;
  private readonly space = new SpacePlot(this.cursor);
  private readonly section: SectionView;
  private readonly squares = new SquaresView();
  private readonly picture = new PictureView();
  private charts: ChartView[];
  private readonly lines = new Map<ChartView, LimitLines>();
  private readonly limited = new Map<string, ChartView>();
  private readonly trouble = h("p", { className: "trouble", role: "alert", hidden: true });
  private readonly remark = h("p", { className: "remark", role: "status", hidden: true });
  private inks = INKS.map(colour);
  private drawn: Drawn[] = [];
  private describing = 0;

  /** Set the vocabularies of columns and limited quantities. */
  constructor(
    private readonly place: HTMLElement,
    vocabulary: QuantityInfo[],
    private readonly limitable: QuantityInfo[],
    private readonly hands: DeskHands,
  ) {
    this.section = new SectionView(this.cursor, alone ? null : hands.bending);
    this.charts = chartsOf(vocabulary).map((chart) => this.charted(chart));
    this.compare = new CompareTable(hands);
    const plots = h("div", { className: "plots" }, ...this.grouped().map(([, element]) => element));
    const all = [
      this.trouble,
      this.remark,
      this.compare.element,
      this.choice(),
      plots,
      glossary(vocabulary, ["omega_deg", ...PLOTS.flatMap((p) => p.columns)]),
    ];
    this.element = h(
      "section",
      { className: "desk", tabIndex: -1, "aria-label": "Plots of the design" },
      ...all,
    );
    this.cursor.listen((omega) => place.classList.toggle("reading", omega !== null));
    plots.addEventListener("pointerleave", () => this.cursor.set(null, this));
  }

  shows(group: string): boolean {
    return GROUPS.includes(group) && this.switched.includes(group) === CLOSED.includes(group);
  }

  /** Draw the current and the pinned designs that have been evaluated. */
  show(design: Design, pins: readonly Pin[], found: readonly (Found | null)[]): void {
    const names = [nameOf(design), ...pins.map((pin) => pin.name)];
    this.drawn = names.flatMap((name, i) =>
      found[i] ? [{ name, ink: this.inks[i], dots: i, found: found[i] }] : [],
    );
    this.compare.show(this.drawn);
    this.place.classList.toggle("many", this.drawn.length > 1);
    this.place.style.setProperty("--pinned", String(this.drawn.length - 1)); // number of table rows, for which plots reserve space
    this.showLimits(design, found[0]);
    for (const chart of this.charts)
      if (this.shows(chart.chart.group)) chart.show(this.drawn, this.isDifference);
    reveal(this.difference.closest("label")!, this.drawn.length > 1);
    if (this.shows("3-D view")) this.space.show(this.drawn);
    if (this.shows("Section")) this.section.show(this.drawn);
    if (this.shows("Squares")) this.squares.show(this.drawn);
    clearTimeout(this.describing);
    this.describing = window.setTimeout(
      () =>
        [...this.charts, this.space, this.section, this.squares].forEach((view) => view.describe()),
      DESCRIBED_MS,
    );
  }

  /** Update the colours after a change of the colour scheme. */
  recolour(): void {
    this.inks = INKS.map(colour);
  }

  /** Insert a figure before all plots. */
  lead(figure: HTMLElement): void {
    this.element.querySelector(".plots")!.prepend(figure);
  }

  /** Update the rendered image. */
  showPicture(design: Design): void {
    if (this.shows("Image")) this.picture.show(design);
  }

  /** Display the error of an invalid design above the plots of the previous one. */
  troubled(sentence: string): void {
    const before = this.drawn.length ? "The plots are those of the last valid design." : "";
    this.trouble.textContent = `${labelledMessage(sentence)}. ${before}`;
    this.trouble.hidden = false;
    this.place.classList.add("stale");
  }

  /** Display a remark on properties that the plots do not include; null if complete. */
  remarked(sentence: string | null): void {
    this.place.classList.remove("stale");
    reveal(this.trouble, false);
    reveal(this.remark, sentence !== null);
    write(this.remark, sentence ?? "");
  }

  /** Show the selected plots only. */
  showGroups(): void {
    for (const [group, element] of this.grouped()) element.hidden = !this.shows(group);
    for (const box of this.element.querySelectorAll<HTMLInputElement>(
      ".groups label:not(.difference) input",
    )) {
      box.checked = this.shows(box.name);
      if (box.name === LIMITS)
        box.closest("label")!.hidden = !this.charts.some((c) => c.chart.group === LIMITS);
    }
  }

  /** Create a chart with its overlays. */
  private charted(chart: Chart): ChartView {
    const lines = new LimitLines(this.hands.limits);
    const isMapping = chart.columns[0].name === "h_px" && !alone;
    const view = new ChartView(
      chart,
      this.cursor,
      isMapping ? [lines, new MappingHandles(this.hands.bending)] : [lines],
    );
    this.lines.set(view, lines);
    return view;
  }

  private limitChart(column: string, quantity: string): ChartView {
    const found =
      this.limited.get(column) ??
      this.charted(
        chartOf(
          this.limitable.find((q) => q.name === quantity)!,
          column,
        ),
      );
    this.limited.set(column, found);
    return found;
  }

  /** Draw limits in the plot of their quantity, and add plots for the others. */
  private showLimits({ requirements }: Design, found: Found | null | undefined): void {
    const rows = found?.rows ?? [];
    const limits = limitsOf(requirements);
    const columns = found?.blocks.find((b) => b.name === "limits")?.columns ?? [];
    const plotted = new Set(PLOTS.flatMap((p) => p.columns));
    const wanted = [
      ...new Set(
        rows
          .filter((r) => r.limit !== null && columns.includes(r.name) && !plotted.has(r.name))
          .map((r) => r.name),
      ),
    ];
    const own = this.charts.filter((c) => c.chart.block === "limits");
    if (wanted.join() !== own.map((c) => c.chart.columns[0].name).join()) {
      for (const chart of own) chart.element.remove();
      const made = wanted.map((name) =>
        this.limitChart(name, limits[rows.find((r) => r.name === name)!.limit!].quantity),
      );
      this.charts = [...this.charts.filter((c) => !own.includes(c)), ...made];
      this.squares.element.before(...made.map((c) => c.element));
      this.showGroups();
    }
    for (const [chart, lines] of this.lines)
      lines.take(linesOf(requirements, rows, chart.chart.columns[0].name, this.limitable));
  }

  private grouped(): [string, HTMLElement][] {
    const charts = this.charts.map((c): [string, HTMLElement] => [c.chart.group, c.element]);
    return [
      ["3-D view", this.space.element],
      ["Section", this.section.element],
      ...charts,
      ["Squares", this.squares.element],
      ["Image", this.picture.element],
    ];
  }

  private choice(): HTMLElement {
    const boxes = GROUPS.map((group) => {
      const box = h("input", { type: "checkbox", checked: this.shows(group), name: group });
      box.addEventListener("change", () => {
        const others = this.switched.filter((g) => g !== group);
        this.switched = box.checked === CLOSED.includes(group) ? [...others, group] : others;
        this.showGroups();
        this.hands.chosen();
      });
      return h("label", {}, box, h("span", {}, group));
    });
    this.difference.addEventListener("change", () => this.compareBy(this.difference.checked));
    const difference = h(
      "label",
      {
        className: "difference",
        hidden: true,
        title: "Plot the difference between the current design and each pinned design",
      },
      this.difference,
      h("span", {}, "Difference"),
    );
    return h(
      "fieldset",
      { className: "groups" },
      h("legend", { className: "hidden" }, "Displayed plots"),
      ...boxes,
      difference,
    );
  }

  /** Plot differences to the pinned designs, or all designs. */
  compareBy(isDifference: boolean): void {
    this.isDifference = this.difference.checked = isDifference;
    for (const chart of this.charts)
      if (this.drawn.length && this.shows(chart.chart.group)) chart.show(this.drawn, isDifference);
  }
}
