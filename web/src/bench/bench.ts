import * as api from "../shared/api";
import { colour, h } from "../shared/dom";
import type { BenchSensor, BenchStart } from "../shared/messages";
import { AWAY } from "../shared/texts";
import { type Found, Link, wishOf } from "./answers";
import { fromAddress, inAddress } from "./designs/address";
import { type Design, History, nameOf, type Pin, placed } from "./designs/design";
import { keep } from "./designs/kept";
import { glossary } from "./glossary";
import type { Host } from "./host";
import { Form } from "./panels/form";
import { WantedPanel } from "./panels/wanted";
import { WorkPanel } from "./panels/work";
import { ChartView, chartsOf, type Drawn, PLOTS } from "./plots/charts";
import { CompareTable } from "./plots/compare";
import { Cursor } from "./plots/cursor";
import { PictureView } from "./plots/picture";
import { SectionView } from "./plots/section";
import { SquaresView } from "./plots/squares";
import { Toolbar } from "./toolbar";

const OWN = "design";
const MOST_PINS = 4;
const INKS = ["accent", "pin1", "pin2", "pin3", "pin4"];
const DESCRIBED_MS = 400;
const GROUPS = ["Section", ...new Set(PLOTS.map((p) => p.group)), "Squares", "Picture"];

/** The design bench: a design, what was found of it, and all that shows and changes it. */
export class Bench {
  history: History;
  pins: Pin[] = [];
  hidden: string[] = [];
  readonly sensors: readonly string[];
  /** How long after its change each of the last designs was drawn, ms: for whoever measures. */
  latencies: number[] = [];
  private found: (Found | null)[] = [];
  private readonly cursor = new Cursor();
  private readonly link: Link;
  private readonly form: Form;
  private readonly wanted: WantedPanel;
  private readonly work: WorkPanel;
  private readonly toolbar: Toolbar;
  private readonly compare: CompareTable;
  private readonly section = new SectionView(this.cursor);
  private readonly squares = new SquaresView();
  private readonly picture = new PictureView();
  private readonly charts: ChartView[];
  private readonly trouble = h("p", { className: "trouble", role: "alert", hidden: true });
  private readonly remark = h("p", { className: "remark", role: "status", hidden: true });
  private describing = 0;

  constructor(private readonly host: Host, private readonly parts: BenchStart, first: Design) {
    this.history = new History(first);
    this.sensors = parts.sensors;
    const aside = h("aside", { "aria-label": "Design" });
    const panel = (title: string): HTMLElement => {
      const body = h("section", { className: "panel", "aria-label": title }, h("h2", {}, title));
      aside.append(body);
      return body;
    };
    const hands = {
      now: () => this.history.now,
      facts: () => this.found[0]?.facts ?? null,
      edit: (design: Design) => this.edit(this.own(design)),
      settle: () => this.settle(),
      change: (what: "mirror" | "lens" | "focus", to: string) => void this.change(what, to),
      take: (found: BenchSensor, words: string) => this.take(found, words),
    };
    this.toolbar = new Toolbar(host, this);
    this.form = new Form(panel("Sensor"), parts, hands);
    this.wanted = new WantedPanel(panel("Requirements"), parts, hands);
    this.work = new WorkPanel(panel("Optimise"), parts, { ...hands, take: (found) => this.takeFound(found) });
    this.charts = chartsOf(parts.columns).map((chart) => new ChartView(chart, this.cursor));
    this.compare = new CompareTable({ take: (i) => this.takePin(i), drop: (i) => this.dropPin(i) });
    const plots = h("div", { className: "plots" }, this.section.element, ...this.charts.map((c) => c.element), this.squares.element, this.picture.element);
    host.place.append(aside, h("section", { className: "desk", tabIndex: -1, "aria-label": "What the design does" }, this.trouble, this.remark, this.compare.element, this.shownGroups(), plots, glossary(parts.columns, ["omega_deg", ...PLOTS.flatMap((p) => p.columns)])));
    this.cursor.listen((omega) => host.place.classList.toggle("reading", omega !== null));
    plots.addEventListener("pointerleave", () => this.cursor.set(null, this));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.restyle());
    this.link = new Link((found) => this.answered(found), (isAway) => host.banner(isAway && host.isShown() ? AWAY : null, "server"));
    host.beforeLeaving(() => this.settle()); // as a number that was typed and not yet entered
    this.bindKeys();
  }

  // -- the design ---------------------------------------------------------------------------------

  /** Try a design, as while a slider is held. */
  edit(design: Design): void {
    this.history.now = design;
    this.form.show(design);
    this.wanted.show(design);
    this.ask();
  }

  /** Go to the design of another address; one that is not whole is told, and changes nothing. */
  goTo(address: string): void {
    if (!address || address === inAddress(this.history.now)) return;
    const found = fromAddress(address, this.parts);
    if (typeof found === "string") return this.misled(found);
    this.host.banner(null, "bench");
    this.takeDesign(found);
  }

  /** Say that the address is none of a design, and have that of what is shown. */
  misled(sentence: string): void {
    this.host.banner(`${sentence} What the bench shows is ${nameOf(this.history.now)}.`, "bench");
    this.kept();
  }

  /** What was a bundled sensor is one no more when something in it is changed. */
  private own(design: Design): Design {
    const { tables } = design;
    const now = this.history.now.tables;
    if (tables === now || tables.name !== now.name || !this.sensors.includes(tables.name as string)) return design;
    return { ...design, tables: { ...tables, name: OWN, notes: "" } };
  }

  /** Settle on the design as it is. */
  settle(): void {
    if (this.history.settle()) this.kept();
    this.toolbar.show();
  }

  /** Put another sensor on the bench; what is asked of it stays. */
  take(sensor: BenchSensor, words: string): void {
    this.edit({ ...this.history.now, tables: sensor.tables, follows: sensor.follows });
    this.settle();
    if (words) this.host.say(words);
  }

  /** Put on the bench what a search has found, with what was there pinned beside it. */
  private takeFound(sensor: BenchSensor): void {
    const before = this.history.now;
    const isFull = this.pins.length >= MOST_PINS || this.pins.some((p) => p.design.tables === before.tables);
    if (!isFull) this.pins = [...this.pins, { name: `${nameOf(before)}, before`, design: before }];
    this.take(sensor, isFull ? "Found" : "Found; what was before is pinned beside it");
    this.pinsChanged();
  }

  takeDesign(design: Design): void {
    this.edit(design);
    this.settle();
  }

  undo(): void {
    this.history.undo();
    this.takeDesign(this.history.now);
    this.kept();
  }

  redo(): void {
    this.history.redo();
    this.takeDesign(this.history.now);
    this.kept();
  }

  async change(what: "mirror" | "lens" | "focus", to: string): Promise<void> {
    try {
      this.take(await api.change({ tables: this.history.now.tables, what, to, object_distance_mm: this.history.now.distance }), "");
    } catch (e) {
      this.fail(e);
      this.form.show(this.history.now);
    }
  }

  fail(e: unknown): void {
    if (!(e instanceof api.Refused || e instanceof api.Away)) throw e;
    this.form.complain({ path: [], sentence: e.message });
    this.host.say(e.message);
  }

  // -- pins ---------------------------------------------------------------------------------------

  pin(): void {
    if (this.pins.length >= MOST_PINS) return this.host.say(`${MOST_PINS} designs are pinned already; unpin one first.`);
    const same = this.pins.filter((p) => p.name.startsWith(nameOf(this.history.now))).length;
    this.pins = [...this.pins, { name: `${nameOf(this.history.now)}${same ? ` ${same + 1}` : ""}`, design: this.history.now }];
    this.host.say("Pinned: change the design, and compare");
    this.pinsChanged();
  }

  private takePin(index: number): void {
    this.takeDesign(this.pins[index].design);
  }

  private dropPin(index: number): void {
    this.pins = this.pins.filter((_, i) => i !== index);
    this.found = this.found.slice(0, 1);
    this.pinsChanged();
  }

  private pinsChanged(): void {
    this.pins.forEach((pin, i) => this.link.ask(i + 1, wishOf({ ...pin.design, wanted: null }, true, false)));
    this.kept();
    this.draw();
    this.toolbar.show();
  }

  // -- questions and answers ------------------------------------------------------------------------

  ask(): void {
    this.link.ask(0, wishOf(this.history.now, !this.hidden.includes("Section"), !this.hidden.includes("Squares")));
  }

  /** Begin, or begin anew with what the address holds. */
  begin(): void {
    this.form.show(this.history.now);
    this.wanted.show(this.history.now);
    this.toolbar.show();
    this.ask();
    this.pinsChanged();
  }

  private answered(found: Found): void {
    if (found.slot > this.pins.length) return;
    if (found.trouble) {
      if (found.slot === 0) this.troubled(found);
      return;
    }
    this.found[found.slot] = found;
    if (found.slot === 0) this.settleFound(found);
    this.draw();
    // charts draw in microtasks of their own, which were queued before this one
    if (found.slot === 0) queueMicrotask(() => (this.latencies = [...this.latencies.slice(-199), performance.now() - found.asked]));
  }

  private troubled(found: Found): void {
    this.form.complain(found.trouble);
    const sentence = found.trouble!.sentence.replace(/^./, (c) => c.toUpperCase());
    this.trouble.textContent = `${sentence}. ${this.found[0] ? "The plots are those of the last design that can be." : ""}`;
    this.trouble.hidden = false;
    this.host.place.classList.add("stale");
  }

  private settleFound(found: Found): void {
    this.host.place.classList.remove("stale");
    this.trouble.hidden = true;
    this.remark.hidden = found.remark === null;
    if (found.remark !== this.remark.textContent) this.remark.textContent = found.remark ?? "";
    this.form.complain(null);
    const complete = placed(this.history.now, found.facts!);
    if (complete !== this.history.now) {
      this.history.complete(complete);
      this.form.show(complete);
    }
    this.wanted.judge(found.rows, found.wanted_trouble);
    if (!this.hidden.includes("Picture")) this.picture.show(this.history.now);
  }

  // -- drawing --------------------------------------------------------------------------------------

  private drawn(): Drawn[] {
    const names = [nameOf(this.history.now), ...this.pins.map((p) => p.name)];
    return names.flatMap((name, i) => {
      const found = this.found[i];
      return found ? [{ name, ink: colour(INKS[i]), dots: i, found }] : [];
    });
  }

  private draw(): void {
    if (!this.found[0]) return;
    const drawn = this.drawn();
    this.compare.show(drawn);
    this.host.place.classList.toggle("many", drawn.length > 1);
    for (const chart of this.charts) if (!this.hidden.includes(chart.chart.group)) chart.show(drawn);
    if (!this.hidden.includes("Section")) this.section.show(drawn);
    if (!this.hidden.includes("Squares")) this.squares.show(drawn);
    this.work.show(this.history.now, this.found[0].facts!.not_optimised);
    clearTimeout(this.describing);
    this.describing = window.setTimeout(() => [...this.charts, this.section, this.squares].forEach((v) => v.describe()), DESCRIBED_MS);
  }

  private restyle(): void {
    this.draw();
    for (const chart of this.charts) chart.restyle();
  }

  private shownGroups(): HTMLElement {
    const boxes = GROUPS.map((group) => {
      const box = h("input", { type: "checkbox", checked: true, name: group });
      box.addEventListener("change", () => {
        this.hidden = box.checked ? this.hidden.filter((g) => g !== group) : [...this.hidden, group];
        this.showGroups();
        this.kept();
        this.ask();
      });
      return h("label", {}, box, h("span", {}, group));
    });
    return h("fieldset", { className: "groups" }, h("legend", { className: "hidden" }, "Plots shown"), ...boxes);
  }

  /** Show the plots that are wanted, and no others. */
  showGroups(): void {
    const views: [string, HTMLElement][] = [["Section", this.section.element], ["Squares", this.squares.element], ["Picture", this.picture.element]];
    for (const [group, element] of [...views, ...this.charts.map((c): [string, HTMLElement] => [c.chart.group, c.element])]) element.hidden = this.hidden.includes(group);
    for (const box of this.host.place.querySelectorAll<HTMLInputElement>(".groups input")) box.checked = !this.hidden.includes(box.name);
    this.draw();
  }

  // -- keeping ----------------------------------------------------------------------------------------

  kept(): void {
    keep(this.history, this.pins, this.hidden);
    this.host.setAddress(inAddress(this.history.now));
  }

  private bindKeys(): void {
    document.addEventListener("keydown", (e) => {
      if (!this.host.isShown() || !(e.ctrlKey || e.metaKey)) return;
      const key = e.key.toLowerCase();
      if (key === "z" || key === "y") {
        e.preventDefault();
        if (key === "y" || e.shiftKey) this.redo();
        else this.undo();
      } else if (key === "s") {
        e.preventDefault();
        void this.toolbar.download("sensor");
      }
    });
  }
}
