import { background } from "../shared/background";
import * as api from "../shared/api";
import { h, hideComputed } from "../shared/dom";
import type { BenchSensor, BenchStart } from "../shared/messages";
import { AWAY } from "../shared/texts";
import { fromAddress, inAddress } from "./designs/address";
import { type Design, History, nameOf, type Pin, placed, type Tables } from "./designs/design";
import { keep } from "./designs/kept";
import { limitsOf, withLimits } from "./designs/requirements";
import { type Found, type Wish, wishOf } from "./found";
import { Bending } from "./hands/bending";
import type { Host } from "./host";
import { bindKeys } from "./keys";
import { Form } from "./panels/form";
import { RequirementsPanel } from "./panels/requirements";
import { WorkPanel } from "./panels/work";
import { Desk } from "./plots/desk";
import * as supply from "./supply";
import { TolerancesPanel } from "./tolerances/panel";
import { Toolbar } from "./toolbar";

const OWN = "design";
const MAX_PINS = 4;
const MARKED_MS = 500; // idle time after which slider marks are requested

/** Return the parts of requirements that determine the plotted quantities. */
const limitedBy = (requirements: Tables | null): string =>
  JSON.stringify([
    requirements?.field,
    limitsOf(requirements).map((l) => [l.quantity, l.cycles_per_px]),
  ]);

/** Design bench: current design, its evaluation, controls and plots. */
export class Bench {
  history: History;
  pins: Pin[] = [];
  readonly desk: Desk;
  readonly sensors: readonly string[];
  /** Time from change to drawing of the last designs, ms, for benchmarks. */
  latencies: number[] = [];
  private found: (Found | null)[] = [];
  private marking = 0;
  /** Requirements for which the pinned designs were evaluated. */
  private limited = "";
  private readonly answers: ReturnType<typeof supply.answers>;
  private readonly bending: Bending;
  private readonly form: Form;
  private readonly requirements: RequirementsPanel;
  private readonly work: WorkPanel;
  private readonly tolerances: TolerancesPanel;
  private readonly toolbar: Toolbar;

  constructor(
    private readonly host: Host,
    private readonly parts: BenchStart,
    first: Design,
  ) {
    this.history = new History(first);
    this.sensors = parts.sensors;
    const aside = h("aside", { "aria-label": "Design" });
    const panel = (title: string): HTMLElement => {
      const body = h(
        "section",
        {
          className: "panel",
          "aria-label": title,
          ...(title === "Sensor" ? {} : { "data-computes": "" }),
        },
        h("h2", {}, title),
      );
      aside.append(body);
      return body;
    };
    const hands = {
      now: () => this.history.now,
      facts: () => this.found[0]?.facts ?? null,
      edit: (design: Design) => this.edit(this.own(design)),
      settle: () => this.settle(),
      change: (what: "mirror" | "lens" | "focus", to: string) => background(this.change(what, to)),
      take: (found: BenchSensor, words: string) => this.take(found, words),
    };
    this.toolbar = new Toolbar(host, this);
    this.form = new Form(panel("Sensor"), parts, hands);
    this.requirements = new RequirementsPanel(panel("Requirements"), parts, hands);
    this.work = new WorkPanel(panel("Optimise"), parts, {
      ...hands,
      take: (found) => this.takeFound(found),
    });
    const trying = {
      now: hands.now,
      show: (design: Design) => this.desk.showPicture(design),
      keep: (text: string) => host.setErrors(text),
      say: host.say,
    };
    this.tolerances = new TolerancesPanel(panel("Tolerances"), trying);
    this.bending = new Bending({
      now: () => this.unbundled(this.history.now),
      ask: (from, bend) => this.answers.ask(0, { ...this.wish(from), bend }),
      isAsked: () => this.answers.isAsked(0),
      settle: () => this.settleBent(),
    });
    this.desk = new Desk(host.place, parts.columns, parts.quantities, {
      take: (i) => this.takePin(i),
      drop: (i) => this.dropPin(i),
      chosen: () => this.plotsChosen(),
      bending: this.bending,
      limits: {
        set: (limit, side, value) => this.setLimit(limit, { [side]: value }),
        settle: () => this.settle(),
      },
    });
    this.desk.lead(this.tolerances.charts.element);
    host.place.append(aside, this.desk.element);
    if (supply.alone) [host.place, host.header].forEach(hideComputed);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.desk.recolour();
      this.draw();
    });
    this.answers = supply.answers(
      (found) => this.answered(found),
      (isAway) => host.banner(isAway && host.isShown() ? AWAY : null, "server"),
    );
    host.beforeLeaving(() => this.settle()); // commit an edited number field whose change event has not fired yet
    bindKeys({
      isShown: host.isShown,
      undo: () => this.undo(),
      redo: () => this.redo(),
      save: () => background(this.toolbar.download("sensor")),
    });
  }

  // -- current design -------------------------------------------------------------------------------

  /** Evaluate a design temporarily, while a slider is moved. */
  edit(design: Design): void {
    this.form.forgetMet(design.requirements !== this.history.now.requirements);
    this.history.now = design;
    this.form.show(design);
    this.requirements.show(design);
    this.ask();
  }

  /** Load the design of another address; an invalid one is reported and ignored. */
  goTo(address: string): void {
    if (!address || address === inAddress(this.history.now)) return;
    const found = fromAddress(address, this.parts);
    if (typeof found === "string") return this.misled(found);
    this.host.banner(null, "bench");
    this.takeDesign(found);
  }

  /** Set the errors of an address; "" for none. */
  tryErrors(text: string): void {
    if (!this.tolerances.goTo(text))
      this.host.banner(
        "The errors in the address are invalid: the link is incomplete or was changed.",
        "bench",
      );
  }

  /** Report an invalid address, and restore the address of the displayed design. */
  misled(sentence: string): void {
    this.host.banner(`${sentence} The design bench displays ${nameOf(this.history.now)}.`, "bench");
    this.kept();
  }

  /** Return the design; a changed bundled sensor gets a new name. */
  private own(design: Design): Design {
    const { tables } = design;
    const now = this.history.now.tables;
    return tables === now || tables.name !== now.name ? design : this.unbundled(design);
  }

  /** Return the design under an editable name: a bundled sensor gets a new one, without its notes. */
  private unbundled(design: Design): Design {
    const { tables } = design;
    return this.sensors.includes(tables.name as string)
      ? { ...design, tables: { ...tables, name: OWN, notes: "" } }
      : design;
  }

  /** Commit the current state of the design. */
  settle(): void {
    if (this.history.settle()) this.kept();
    this.toolbar.show();
  }

  /** Load another sensor; the requirements are kept. */
  take(sensor: BenchSensor, words: string): void {
    this.edit({ ...this.history.now, tables: sensor.tables, follows: sensor.follows });
    this.settle();
    this.form.begin(this.history.now);
    if (words) this.host.say(words);
  }

  /** Load the result of a search, and pin the previous design. */
  private takeFound(sensor: BenchSensor): void {
    const before = this.history.now;
    const isFull =
      this.pins.length >= MAX_PINS || this.pins.some((p) => p.design.tables === before.tables);
    if (!isFull) this.pins = [...this.pins, { name: `${nameOf(before)}, before`, design: before }];
    this.take(
      sensor,
      isFull
        ? "Search complete"
        : "Search complete; the previous design is pinned, and plots display the difference",
    );
    this.pinsChanged();
    this.desk.compareBy(!isFull);
  }

  takeDesign(design: Design): void {
    this.edit(design);
    this.settle();
  }

  /** Replace the requirements, and display them. */
  takeRequirements(requirements: Tables): void {
    this.takeDesign({ ...this.history.now, requirements });
    this.requirements.reveal();
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
      this.take(
        await supply.change({
          tables: this.history.now.tables,
          what,
          to,
          object_distance_mm: this.history.now.distance,
        }),
        "",
      );
    } catch (e) {
      this.fail(e);
      this.form.show(this.history.now);
    }
  }

  fail(e: unknown): void {
    if (!api.isForeseen(e)) return reportError(e);
    this.form.complain({ path: [], sentence: e.message });
    this.host.say(e.message);
  }

  // -- direct manipulation of plots -----------------------------------------------------------------

  private takeBent(sensor: BenchSensor): void {
    this.history.now = { ...this.history.now, tables: sensor.tables, follows: sensor.follows };
    this.form.forgetMet(true);
    this.form.show(this.history.now);
  }

  private settleBent(): void {
    this.form.begin(this.history.now);
    this.settle();
    this.ask(); // an infeasible point can invalidate the displayed design
  }

  private setLimit(index: number, change: { at_least?: number; at_most?: number }): void {
    const { requirements } = this.history.now;
    const limits = limitsOf(requirements).map((l, i) => (i === index ? { ...l, ...change } : l));
    this.edit({ ...this.history.now, requirements: withLimits(requirements!, limits) });
  }

  // -- pinned designs -------------------------------------------------------------------------------

  pin(): void {
    if (this.pins.length >= MAX_PINS)
      return this.host.say(`${MAX_PINS} designs can be pinned; unpin one first.`);
    const same = this.pins.filter((p) => p.name.startsWith(nameOf(this.history.now))).length;
    this.pins = [
      ...this.pins,
      {
        name: `${nameOf(this.history.now)}${same ? ` ${same + 1}` : ""}`,
        design: this.history.now,
      },
    ];
    this.host.say("Pinned; plots compare it with the current design");
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
    this.askPins();
    this.kept();
    this.draw();
    this.toolbar.show();
  }

  /** Evaluate the pinned designs with the current requirements, so that their values share the plots. */
  private askPins(): void {
    const { requirements } = this.history.now;
    this.limited = limitedBy(requirements);
    this.pins.forEach((pin, i) =>
      this.answers.ask(
        i + 1,
        wishOf({ ...pin.design, requirements }, { section: true, squares: false, space: false }),
      ),
    );
  }

  // -- requests and responses -----------------------------------------------------------------------

  ask(): void {
    this.answers.ask(0, this.wish(this.history.now));
    if (limitedBy(this.history.now.requirements) !== this.limited) this.askPins();
  }

  private wish(design: Design): Wish {
    const { desk } = this;
    return wishOf(design, {
      section: desk.shows("Section"),
      squares: desk.shows("Squares"),
      space: desk.shows("3-D view"),
    });
  }

  /** Start, or restart with the design of the address. */
  begin(): void {
    this.form.show(this.history.now);
    this.requirements.show(this.history.now);
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
    if (found.bent) this.takeBent(found.bent);
    if (found.slot === 0) this.settleFound(found);
    this.draw();
    this.bending.answered();
    // charts draw in microtasks that were queued earlier
    if (found.slot === 0)
      queueMicrotask(
        () => (this.latencies = [...this.latencies.slice(-199), performance.now() - found.asked]),
      );
  }

  private troubled(found: Found): void {
    this.form.complain(found.trouble);
    this.desk.troubled(found.trouble!.sentence);
    this.bending.answered();
  }

  private settleFound(found: Found): void {
    this.desk.remarked(found.remark);
    this.form.complain(null);
    const complete = placed(this.history.now, found.facts!);
    if (complete !== this.history.now) {
      this.history.complete(complete);
      this.form.show(complete);
    }
    this.requirements.judge(found.rows, found.requirements_trouble);
    clearTimeout(this.marking);
    if (found.rows.length)
      this.marking = window.setTimeout(() => background(this.markMet()), MARKED_MS);
    this.desk.showPicture(this.tolerances.pictured(this.history.now));
    this.tolerances.follow();
  }

  /** Request the feasible ranges of sliders after an idle time. */
  private async markMet(): Promise<void> {
    const { now, isHeld } = this.history;
    if (isHeld || !now.requirements) return;
    const slides = this.form.slides();
    const asked = {
      tables: now.tables,
      follows: now.follows,
      requirements: now.requirements,
      slides,
    };
    const found = await supply.slides(asked).catch(() => null); // marks are optional
    if (found && now === this.history.now) this.form.showMet(slides, found.missed);
  }

  private draw(): void {
    const [first] = this.found;
    if (!first) return;
    this.desk.show(this.history.now, this.pins, this.found);
    this.work.show(this.history.now, first.facts!.not_optimised);
  }

  private plotsChosen(): void {
    this.draw();
    this.kept();
    this.ask();
  }

  // -- storage --------------------------------------------------------------------------------------

  kept(): void {
    keep(this.history, this.pins, this.desk.switched);
    this.host.setAddress(inAddress(this.history.now));
  }
}
