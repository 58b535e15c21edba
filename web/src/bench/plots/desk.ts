import { colour, h } from "../../shared/dom";
import type { QuantityOf } from "../../shared/messages";
import type { Found } from "../found";
import { type Design, nameOf, type Pin } from "../designs/design";
import { glossary } from "../glossary";
import { alone } from "../supply";
import { chartsOf, ChartView, type Drawn, PLOTS } from "./charts";
import { CompareTable, type PinHands } from "./compare";
import { Cursor } from "./cursor";
import { PictureView } from "./picture";
import { SectionView } from "./section";
import { SpacePlot } from "./space";
import { SquaresView } from "./squares";

const INKS = ["accent", "pin1", "pin2", "pin3", "pin4"];
const DESCRIBED_MS = 400; // after which charts that rest are put into words

/** Kinds of plots, each shown or not. */
const COMPUTED = ["In space", "Picture"]; // by the server alone
const GROUPS = ["In space", "Section", ...new Set(PLOTS.map((p) => p.group)), "Squares", "Picture"].filter((group) => !(alone && COMPUTED.includes(group)));
const CLOSED = ["In space"]; // until they are opened

/** What lies on the bench's desk: the table of designs, and the plots of what they do. */
export class Desk {
  readonly element: HTMLElement;
  /** Kinds of plots that are not as they are at first. */
  switched: string[] = [];
  /** Whether plots are of what the design in hand has more than the pinned ones. */
  private isDifference = false;
  private readonly difference = h("input", { type: "checkbox", name: "Difference" });
  private readonly cursor = new Cursor();
  private readonly compare: CompareTable;
  private readonly space = new SpacePlot(this.cursor);
  private readonly section = new SectionView(this.cursor);
  private readonly squares = new SquaresView();
  private readonly picture = new PictureView();
  private readonly charts: ChartView[];
  private readonly trouble = h("p", { className: "trouble", role: "alert", hidden: true });
  private readonly remark = h("p", { className: "remark", role: "status", hidden: true });
  private inks = INKS.map(colour);
  private drawn: Drawn[] = [];
  private describing = 0;

  /** The vocabulary says what columns are called; `chosen` is told when other plots are wanted. */
  constructor(private readonly place: HTMLElement, vocabulary: QuantityOf[], pins: PinHands, private readonly chosen: () => void) {
    this.charts = chartsOf(vocabulary).map((chart) => new ChartView(chart, this.cursor));
    this.compare = new CompareTable(pins);
    const plots = h("div", { className: "plots" }, ...this.grouped().map(([, element]) => element));
    const all = [this.trouble, this.remark, this.compare.element, this.choice(), plots, glossary(vocabulary, ["omega_deg", ...PLOTS.flatMap((p) => p.columns)])];
    this.element = h("section", { className: "desk", tabIndex: -1, "aria-label": "What the design does" }, ...all);
    this.cursor.listen((omega) => place.classList.toggle("reading", omega !== null));
    plots.addEventListener("pointerleave", () => this.cursor.set(null, this));
  }

  shows(group: string): boolean {
    return GROUPS.includes(group) && this.switched.includes(group) === CLOSED.includes(group);
  }

  /** Draw the design in hand and the pinned ones, as far as they have been answered. */
  show(design: Design, pins: readonly Pin[], found: readonly (Found | null)[]): void {
    const names = [nameOf(design), ...pins.map((pin) => pin.name)];
    this.drawn = names.flatMap((name, i) => (found[i] ? [{ name, ink: this.inks[i], dots: i, found: found[i] }] : []));
    this.compare.show(this.drawn);
    this.place.classList.toggle("many", this.drawn.length > 1);
    this.place.style.setProperty("--pinned", String(this.drawn.length - 1)); // lines of the table, for which plots make room
    for (const chart of this.charts) if (this.shows(chart.chart.group)) chart.show(this.drawn, this.isDifference);
    this.difference.closest("label")!.hidden = this.drawn.length < 2;
    if (this.shows("In space")) this.space.show(this.drawn);
    if (this.shows("Section")) this.section.show(this.drawn);
    if (this.shows("Squares")) this.squares.show(this.drawn);
    clearTimeout(this.describing);
    this.describing = window.setTimeout(() => [...this.charts, this.space, this.section, this.squares].forEach((view) => view.describe()), DESCRIBED_MS);
  }

  /** Take the page's colours, which are others in the dark. */
  recolour(): void {
    this.inks = INKS.map(colour);
  }

  /** Put a figure before all plots. */
  lead(figure: HTMLElement): void {
    this.element.querySelector(".plots")!.prepend(figure);
  }

  /** Show the picture that the design takes. */
  showPicture(design: Design): void {
    if (this.shows("Picture")) this.picture.show(design);
  }

  /** Say why the design cannot be, over the plots of the one before. */
  troubled(sentence: string): void {
    const before = this.drawn.length ? "The plots are those of the last design that can be." : "";
    this.trouble.textContent = `${sentence.replace(/^./, (c) => c.toUpperCase())}. ${before}`;
    this.trouble.hidden = false;
    this.place.classList.add("stale");
  }

  /** Say what of the sensor the plots do not show; null where they show all. */
  remarked(sentence: string | null): void {
    this.place.classList.remove("stale");
    this.trouble.hidden = true;
    this.remark.hidden = sentence === null;
    if (sentence !== this.remark.textContent) this.remark.textContent = sentence ?? "";
  }

  /** Show the plots that are wanted, and no others. */
  showGroups(): void {
    for (const [group, element] of this.grouped()) element.hidden = !this.shows(group);
    for (const box of this.element.querySelectorAll<HTMLInputElement>(".groups label:not(.difference) input")) box.checked = this.shows(box.name);
  }

  private grouped(): [string, HTMLElement][] {
    const charts = this.charts.map((c): [string, HTMLElement] => [c.chart.group, c.element]);
    return [["In space", this.space.element], ["Section", this.section.element], ...charts, ["Squares", this.squares.element], ["Picture", this.picture.element]];
  }

  private choice(): HTMLElement {
    const boxes = GROUPS.map((group) => {
      const box = h("input", { type: "checkbox", checked: this.shows(group), name: group });
      box.addEventListener("change", () => {
        const others = this.switched.filter((g) => g !== group);
        this.switched = box.checked === CLOSED.includes(group) ? [...others, group] : others;
        this.showGroups();
        this.chosen();
      });
      return h("label", {}, box, h("span", {}, group));
    });
    this.difference.addEventListener("change", () => this.compareBy(this.difference.checked));
    const difference = h("label", { className: "difference", hidden: true, title: "Plot by how much the design in hand exceeds each pinned one" }, this.difference, h("span", {}, "Difference"));
    return h("fieldset", { className: "groups" }, h("legend", { className: "hidden" }, "Plots shown"), ...boxes, difference);
  }

  /** Plot differences to the pinned designs, or all designs as they are. */
  compareBy(isDifference: boolean): void {
    this.isDifference = this.difference.checked = isDifference;
    for (const chart of this.charts) if (this.drawn.length && this.shows(chart.chart.group)) chart.show(this.drawn, isDifference);
  }
}
