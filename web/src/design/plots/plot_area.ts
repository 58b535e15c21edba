import { colour, h, reveal, write } from "../../shared/dom";
import type { QuantityInfo } from "../../shared/messages";
import type { Evaluation } from "../evaluation";
import { type Design, nameOf, type Pin } from "../model/design";
import { limitsOf } from "../model/requirements";
import { glossary } from "../glossary";
import type { EditCallbacks } from "../handles/handle";
import { type LimitCallbacks, LimitLines, linesOf } from "../handles/limits";
import { MappingHandles } from "../handles/mapping";
import { labelledMessage } from "../labels";
import { alone } from "../data_source";
import { ChartView, type Drawn } from "./charts";
import { CompareTable, type PinCallbacks } from "./compare";
import { Cursor } from "./cursor";
import { RenderedImageView } from "./rendered_image";
import { type Chart, chartOf, chartsOf, PLOTS } from "./quantities";
import { SectionView } from "./section";
import { SpacePlot } from "./space";
import { SquaresView } from "./squares";

const INKS = ["accent", "pin1", "pin2", "pin3", "pin4"];
const DESCRIPTION_DELAY_MS = 400; // idle time after which descriptions of charts are updated

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
interface PlotCallbacks extends PinCallbacks {
  curveEditing: EditCallbacks;
  limits: LimitCallbacks;
  /** Called if the set of displayed plots changes. */
  chosen: () => void;
}

/** Main area of the Design tab: table of designs and plots. */
export class PlotArea {
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
  private readonly image = new RenderedImageView();
  private charts: ChartView[];
  private readonly lines = new Map<ChartView, LimitLines>();
  private readonly limited = new Map<string, ChartView>();
  private readonly error = h("p", { className: "trouble", role: "alert", hidden: true });
  private readonly note = h("p", { className: "remark", role: "status", hidden: true });
  private inks = INKS.map(colour);
  private drawn: Drawn[] = [];
  private describing = 0;

  /** Set the vocabularies of columns and limited quantities. */
  constructor(
    private readonly place: HTMLElement,
    vocabulary: QuantityInfo[],
    private readonly limitable: QuantityInfo[],
    private readonly callbacks: PlotCallbacks,
  ) {
    this.section = new SectionView(this.cursor, alone ? null : callbacks.curveEditing);
    this.charts = chartsOf(vocabulary).map((chart) => this.charted(chart));
    this.compare = new CompareTable(callbacks);
    const plots = h("div", { className: "plots" }, ...this.grouped().map(([, element]) => element));
    const all = [
      this.error,
      this.note,
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
  show(design: Design, pins: readonly Pin[], evaluation: readonly (Evaluation | null)[]): void {
    const names = [nameOf(design), ...pins.map((pin) => pin.name)];
    this.drawn = names.flatMap((name, i) =>
      evaluation[i] ? [{ name, ink: this.inks[i], dots: i, evaluation: evaluation[i] }] : [],
    );
    this.compare.show(this.drawn);
    this.place.classList.toggle("many", this.drawn.length > 1);
    this.place.style.setProperty("--pinned", String(this.drawn.length - 1)); // number of table rows, for which plots reserve space
    this.showLimits(design, evaluation[0]);
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
      DESCRIPTION_DELAY_MS,
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
  showRenderedImage(design: Design): void {
    if (this.shows("Image")) this.image.show(design);
  }

  /** Display the error of an invalid design above the plots of the previous one. */
  showError(message: string): void {
    const before = this.drawn.length ? "The plots are those of the last valid design." : "";
    this.error.textContent = `${labelledMessage(message)}. ${before}`;
    this.error.hidden = false;
    this.place.classList.add("stale");
  }

  /** Display a remark on properties that the plots do not include; null if complete. */
  showNote(message: string | null): void {
    this.place.classList.remove("stale");
    reveal(this.error, false);
    reveal(this.note, message !== null);
    write(this.note, message ?? "");
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
    const lines = new LimitLines(this.callbacks.limits);
    const isMapping = chart.columns[0].name === "h_px" && !alone;
    const view = new ChartView(
      chart,
      this.cursor,
      isMapping ? [lines, new MappingHandles(this.callbacks.curveEditing)] : [lines],
    );
    this.lines.set(view, lines);
    return view;
  }

  private limitChart(column: string, quantity: string): ChartView {
    const evaluation =
      this.limited.get(column) ??
      this.charted(
        chartOf(
          this.limitable.find((q) => q.name === quantity)!,
          column,
        ),
      );
    this.limited.set(column, evaluation);
    return evaluation;
  }

  /** Draw limits in the plot of their quantity, and add plots for the others. */
  private showLimits({ requirements }: Design, evaluation: Evaluation | null | undefined): void {
    const rows = evaluation?.rows ?? [];
    const limits = limitsOf(requirements);
    const columns = evaluation?.blocks.find((b) => b.name === "limits")?.columns ?? [];
    const plotted = new Set(PLOTS.flatMap((p) => p.columns));
    const quantities = [
      ...new Set(
        rows
          .filter((r) => r.limit !== null && columns.includes(r.name) && !plotted.has(r.name))
          .map((r) => r.name),
      ),
    ];
    const own = this.charts.filter((c) => c.chart.block === "limits");
    if (quantities.join() !== own.map((c) => c.chart.columns[0].name).join()) {
      for (const chart of own) chart.element.remove();
      const charts_ = quantities.map((name) =>
        this.limitChart(name, limits[rows.find((r) => r.name === name)!.limit!].quantity),
      );
      this.charts = [...this.charts.filter((c) => !own.includes(c)), ...charts_];
      this.squares.element.before(...charts_.map((c) => c.element));
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
      ["Image", this.image.element],
    ];
  }

  private choice(): HTMLElement {
    const boxes = GROUPS.map((group) => {
      const box = h("input", { type: "checkbox", checked: this.shows(group), name: group });
      box.addEventListener("change", () => {
        const additional = this.switched.filter((g) => g !== group);
        this.switched =
          box.checked === CLOSED.includes(group) ? [...additional, group] : additional;
        this.showGroups();
        this.callbacks.chosen();
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
