import { background } from "../shared/background";
import * as api from "../shared/api";
import { h, hideComputed } from "../shared/dom";
import type { DesignSensor, DesignStart } from "../shared/messages";
import { SERVER_UNAVAILABLE } from "../shared/texts";
import { fromAddress, inAddress } from "./model/address";
import { type Design, History, nameOf, type Pin, placed, type Tables } from "./model/design";
import { keep } from "./model/storage";
import { limitsOf, withLimits } from "./model/requirements";
import { type Evaluation, type EvaluationOptions, optionsOf } from "./evaluation";
import { CurveEditing } from "./handles/curve_editing";
import type { Host } from "./host";
import { bindKeys } from "./keys";
import { ExportDialog } from "./panels/export";
import { Form } from "./panels/form";
import { RequirementsPanel } from "./panels/requirements";
import { WorkPanel } from "./panels/search";
import { PlotArea } from "./plots/plot_area";
import * as supply from "./data_source";
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

/** Design tab: current design, its evaluation, controls and plots. */
export class DesignTab {
  history: History;
  pins: Pin[] = [];
  readonly plotArea: PlotArea;
  readonly sensors: readonly string[];
  /** Time from change to drawing of the last designs, ms, for benchmarks. */
  latencies: number[] = [];
  private evaluations: (Evaluation | null)[] = [];
  private marking = 0;
  /** Requirements for which the pinned designs were evaluated. */
  private limited = "";
  private readonly evaluator: ReturnType<typeof supply.evaluator>;
  private readonly curveEditing: CurveEditing;
  private readonly form: Form;
  private readonly requirements: RequirementsPanel;
  private readonly work: WorkPanel;
  private readonly tolerances: TolerancesPanel;
  private readonly toolbar: Toolbar;
  private readonly exportDialog: ExportDialog;

  constructor(
    private readonly host: Host,
    private readonly parts: DesignStart,
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
    const callbacks = {
      now: () => this.history.now,
      summary: () => this.evaluations[0]?.summary ?? null,
      edit: (design: Design) => this.edit(this.own(design)),
      settle: (control?: string | null) => this.settle(control),
      change: (target: "mirror" | "lens" | "focus", to: string) =>
        background(this.change(target, to)),
      take: (evaluations: DesignSensor, words: string) => this.take(evaluations, words),
    };
    this.toolbar = new Toolbar(host, this);
    this.form = new Form(panel("Sensor"), parts, callbacks);
    this.requirements = new RequirementsPanel(panel("Requirements"), parts, callbacks);
    this.work = new WorkPanel(panel("Optimise"), parts, {
      ...callbacks,
      take: (sensor, isOptimised) => this.takeResult(sensor, isOptimised),
      relax: (requirements) => this.takeDesign({ ...this.history.now, requirements }),
    });
    const settings = {
      now: callbacks.now,
      show: (design: Design) => this.plotArea.showRenderedImage(design),
      keep: (text: string) => host.setErrors(text),
      say: host.say,
    };
    this.tolerances = new TolerancesPanel(panel("Tolerances"), settings);
    this.curveEditing = new CurveEditing({
      now: () => this.unbundled(this.history.now),
      ask: (from, edit) => this.evaluator.ask(0, { ...this.options(from), edit }),
      isPending: () => this.evaluator.isPending(0),
      settle: (control) => this.settleEdited(control),
    });
    this.plotArea = new PlotArea(host.place, parts.columns, parts.quantities, {
      take: (i) => this.takePin(i),
      drop: (i) => this.dropPin(i),
      chosen: () => this.plotsChosen(),
      curveEditing: this.curveEditing,
      limits: {
        set: (limit, side, value) => this.setLimit(limit, { [side]: value }),
        settle: (control) => this.settle(control),
      },
    });
    this.plotArea.lead(this.tolerances.charts.element);
    host.place.append(aside, this.plotArea.element);
    this.exportDialog = new ExportDialog(host.place, {
      now: callbacks.now,
      tolerances: () => this.tolerances.plan,
      fail: (e) => this.fail(e),
    });
    if (supply.alone) [host.place, host.header].forEach(hideComputed);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.plotArea.recolour();
      this.draw();
    });
    this.evaluator = supply.evaluator(
      (evaluations) => this.onEvaluation(evaluations),
      (isUnavailable) =>
        host.banner(isUnavailable && host.isShown() ? SERVER_UNAVAILABLE : null, "server"),
    );
    host.beforeLeaving(() => this.settle()); // commit an edited number field whose change event has not fired yet
    bindKeys({
      isShown: host.isShown,
      undo: () => this.undo(),
      redo: () => this.redo(),
      save: () => background(this.toolbar.saveSensor()),
    });
  }

  // -- current design -------------------------------------------------------------------------------

  /** Evaluate a design temporarily, while a slider is moved. */
  edit(design: Design): void {
    this.form.clearFeasible(design.requirements !== this.history.now.requirements);
    this.history.now = design;
    this.form.show(design);
    this.requirements.show(design);
    this.ask();
  }

  /** Load the design of another address; an invalid one is reported and ignored. */
  goTo(address: string): void {
    if (!address || address === inAddress(this.history.now)) return;
    const evaluations = fromAddress(address, this.parts);
    if (typeof evaluations === "string") return this.reportInvalidAddress(evaluations);
    this.host.banner(null, "design");
    this.takeDesign(evaluations);
  }

  /** Set the errors of an address; "" for none. */
  setErrorsFrom(text: string): void {
    if (!this.tolerances.goTo(text))
      this.host.banner(
        "The errors in the address are invalid: the link is incomplete or was changed.",
        "design",
      );
  }

  /** Report an invalid address, and restore the address of the displayed design. */
  reportInvalidAddress(message: string): void {
    this.host.banner(`${message} The Design tab displays ${nameOf(this.history.now)}.`, "design");
    this.store();
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
  settle(control: string | null = null): void {
    if (this.history.settle(control)) this.store();
    this.toolbar.show();
  }

  /** Load another sensor; the requirements are kept. */
  take(sensor: DesignSensor, words: string): void {
    this.edit({
      ...this.history.now,
      tables: sensor.tables,
      follows_mapping: sensor.follows_mapping,
    });
    this.settle();
    this.form.begin(this.history.now);
    if (words) this.host.say(words);
  }

  /** Load the result of a search; the previous design of an optimisation is pinned. */
  private takeResult(sensor: DesignSensor, isOptimised: boolean): void {
    const before = this.history.now;
    const isPinned = this.pins.some((p) => p.design.tables === before.tables);
    const isStored = isOptimised && !isPinned && this.pins.length < MAX_PINS;
    if (isStored) this.pins = [...this.pins, { name: `${nameOf(before)}, before`, design: before }];
    this.take(
      sensor,
      isStored
        ? "Search complete; the previous design is pinned for comparison"
        : "Search complete; Undo restores the previous design",
    );
    if (isStored) this.pinsChanged();
    this.plotArea.compareBy(false);
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
    this.store();
  }

  redo(): void {
    this.history.redo();
    this.takeDesign(this.history.now);
    this.store();
  }

  openExport(): void {
    this.settle();
    background(this.exportDialog.open());
  }

  async change(target: "mirror" | "lens" | "focus", to: string): Promise<void> {
    try {
      this.take(
        await supply.change({
          tables: this.history.now.tables,
          target,
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
    if (!api.isUserError(e)) return reportError(e);
    this.form.showError({ path: [], message: e.message });
    this.host.say(e.message);
  }

  // -- direct manipulation of plots -----------------------------------------------------------------

  private takeEdited(sensor: DesignSensor): void {
    this.history.now = {
      ...this.history.now,
      tables: sensor.tables,
      follows_mapping: sensor.follows_mapping,
    };
    this.form.clearFeasible(true);
    this.form.show(this.history.now);
  }

  private settleEdited(control: string | null): void {
    this.form.begin(this.history.now);
    this.settle(control);
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
    this.evaluations = this.evaluations.slice(0, 1);
    this.pinsChanged();
  }

  private pinsChanged(): void {
    this.askPins();
    this.store();
    this.draw();
    this.toolbar.show();
  }

  /** Evaluate the pinned designs with the current requirements, so that their values share the plots. */
  private askPins(): void {
    const { requirements } = this.history.now;
    this.limited = limitedBy(requirements);
    this.pins.forEach((pin, i) =>
      this.evaluator.ask(
        i + 1,
        optionsOf(
          { ...pin.design, requirements },
          { include_section: true, include_squares: false, include_3d: false },
        ),
      ),
    );
  }

  // -- requests and responses -----------------------------------------------------------------------

  ask(): void {
    this.evaluator.ask(0, this.options(this.history.now));
    if (limitedBy(this.history.now.requirements) !== this.limited) this.askPins();
  }

  private options(design: Design): EvaluationOptions {
    const { plotArea } = this;
    return optionsOf(design, {
      include_section: plotArea.shows("Section"),
      include_squares: plotArea.shows("Squares"),
      include_3d: plotArea.shows("3-D view"),
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

  private onEvaluation(evaluations: Evaluation): void {
    if (evaluations.slot > this.pins.length) return;
    if (evaluations.error) {
      if (evaluations.slot === 0) this.showError(evaluations);
      return;
    }
    this.evaluations[evaluations.slot] = evaluations;
    if (evaluations.edited) this.takeEdited(evaluations.edited);
    if (evaluations.slot === 0) this.applyEvaluation(evaluations);
    this.draw();
    this.curveEditing.onEvaluation();
    // charts draw in microtasks that were queued earlier
    if (evaluations.slot === 0)
      queueMicrotask(
        () =>
          (this.latencies = [
            ...this.latencies.slice(-199),
            performance.now() - evaluations.request,
          ]),
      );
  }

  private showError(evaluations: Evaluation): void {
    this.form.showError(evaluations.error);
    this.plotArea.showError(evaluations.error!.message);
    this.curveEditing.onEvaluation();
  }

  private applyEvaluation(evaluations: Evaluation): void {
    this.plotArea.showNote(evaluations.note);
    this.form.showError(null);
    const complete = placed(this.history.now, evaluations.summary!);
    if (complete !== this.history.now) {
      this.history.complete(complete);
      this.form.show(complete);
    }
    this.requirements.showResults(evaluations.rows, evaluations.requirements_error);
    clearTimeout(this.marking);
    if (evaluations.rows.length)
      this.marking = window.setTimeout(() => background(this.markFeasible()), MARKED_MS);
    this.plotArea.showRenderedImage(this.tolerances.renderedDesign(this.history.now));
    this.tolerances.follow();
  }

  /** Request the feasible ranges of sliders after an idle time. */
  private async markFeasible(): Promise<void> {
    const { now, isHeld } = this.history;
    if (isHeld || !now.requirements) return;
    const sliders = this.form.sliders();
    const request = {
      tables: now.tables,
      follows_mapping: now.follows_mapping,
      requirements: now.requirements,
      sliders,
    };
    const ranges = await supply.feasibleRanges(request).catch(() => null); // marks are optional
    if (ranges && now === this.history.now) this.form.showFeasible(sliders, ranges.violations);
  }

  private draw(): void {
    const [first] = this.evaluations;
    if (!first) return;
    this.plotArea.show(this.history.now, this.pins, this.evaluations);
    this.work.show(this.history.now, first.summary!.not_optimised);
  }

  private plotsChosen(): void {
    this.draw();
    this.store();
    this.ask();
  }

  // -- storage --------------------------------------------------------------------------------------

  store(): void {
    keep(this.history, this.pins, this.plotArea.switched);
    this.host.setAddress(inAddress(this.history.now));
  }
}
