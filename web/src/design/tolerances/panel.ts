import * as api from "../../shared/api";
import { h, labelledField, titledSection } from "../../shared/dom";
import type {
  AsBuiltRequest,
  ErrorSourceInfo,
  ErrorSourcesRequest,
  ErrorSourceList,
  TolerancePlanMessage,
  YieldRequest,
  YieldResult,
} from "../../shared/messages";
import { fixed, words } from "../../shared/numbers";
import type { Design, Tables } from "../model/design";
import { type AsBuiltDisplacement, ToleranceCharts } from "./charts";
import { RequestQueue } from "./request_queue";
import { ErrorRow } from "./rows";
import {
  FOCUSES,
  GRADES,
  MEASURES,
  textOf,
  type ErrorSettings,
  errorSettingsOf,
} from "./error_settings";
import {
  calibrationWords,
  capital,
  errorWords,
  gradeTolerances,
  meritName,
  sizeWords,
} from "./names";

const QUANTITIES: Record<(typeof MEASURES)[number], string> = {
  motion_px: "Displacement, px",
  direction_error_deg: "Direction error, °",
  straightness_deg: "Straightness, °",
  blur_px: "Blur, px",
};
const USUAL: Record<string, number> = {
  motion_px: 0.5,
  direction_error_deg: 0.1,
  straightness_deg: 0.05,
};
const MORE_BLUR = 1.2; // default limit as a multiple of the value without errors
const FOCUS: Record<(typeof FOCUSES)[number], string> = {
  none: "as designed",
  rms: "refocused, minimum RMS",
  worst: "refocused, minimum maximum",
};
const TRIALS = 4096;
const SEED = 0;
const DIGITS = 4; // decimals of random errors, which are part of the address

/** Interface of the Design tab for the panel. */
interface Callbacks {
  now: () => Design;
  /** Render the image of the sensor with errors. */
  show: (design: Design) => void;
  /** Store the errors as text; "" for none. */
  keep: (text: string) => void;
  say: (message: string) => void;
}

/** Sliders of all error sources of a sensor, and the predicted yield for given tolerances. */
export class TolerancesPanel {
  readonly charts = new ToleranceCharts();
  private readonly errors = new RequestQueue(
    (request: ErrorSourcesRequest) => api.errors(request),
    (result, request) => this.known(result, request),
    (message) => this.fail(message),
  );
  private readonly built = new RequestQueue(
    (request: AsBuiltRequest) => api.built(request),
    (moved, request) => this.moved(moved, request),
    (message) => this.fail(message),
  );
  private readonly yields = new RequestQueue(
    (request: YieldRequest) => api.yields(request),
    (result) => this.good(result),
    (message) => this.fail(message),
  );
  private readonly begin = h(
    "button",
    { type: "button", "aria-expanded": "false", onclick: () => this.toggle() },
    "Analyse tolerances",
  );
  private readonly body = h("div", { className: "tolerance-body", hidden: true });
  private readonly grade = select(
    "Tolerance grade",
    GRADES.map((g) => [g, g]),
    () => this.grades(),
  );
  private readonly after = select("Calibration", [["none", calibrationWords("none")]], () =>
    this.judged(),
  );
  private readonly focus = select("Focus", Object.entries(FOCUS), () => this.request());
  private readonly quantity = select("Requirement", Object.entries(QUANTITIES), () =>
    this.chosen(),
  );
  private readonly limit = h("input", {
    type: "number",
    min: "0",
    step: "any",
    value: "0.5",
    "aria-label": "Maximum",
  });
  private readonly verdict = h("p", { className: "verdict", role: "status" });
  private readonly summary = h("ul", { className: "others" });
  private readonly problem = h("p", { className: "problem", role: "alert", hidden: true });
  private readonly groups = h("div", { className: "groups-of-errors" });
  private all: ErrorSourceList | null = null;
  private tables: Tables | null = null;
  private values = new Map<string, number>();
  private tolerances = new Map<string, number>();
  private readonly rows = new Map<string, ErrorRow>();
  private last: AsBuiltDisplacement | null = null;
  /** Errors to be set when the error sources are loaded. */
  private requested: ErrorSettings | null = null;

  constructor(
    place: HTMLElement,
    private readonly callbacks: Callbacks,
  ) {
    this.grade.input.value = "medium";
    this.limit.addEventListener("change", () => this.judged());
    const row = h(
      "div",
      { className: "row" },
      h("button", { type: "button", onclick: () => this.draw() }, "Random sensor"),
      h("button", { type: "button", onclick: () => this.none() }, "Reset errors"),
    );
    const maximum = h(
      "div",
      { className: "field" },
      h("span", { className: "unit" }, "at most"),
      h("span", { className: "entry" }, this.limit),
    );
    this.body.append(
      this.focus.element,
      this.after.element,
      titledSection("Yield", this.grade.element, this.quantity.element, maximum, this.verdict),
      titledSection("Present errors of this sensor", this.summary, row),
      this.problem,
      h("p", { className: "words" }, "Each error: present value ± tolerance of the yield"),
      this.groups,
    );
    place.append(h("div", { className: "row" }, this.begin), this.body);
  }

  private get isOpen(): boolean {
    return !this.body.hidden;
  }

  /** Set the current design. */
  follow(): void {
    const { tables } = this.callbacks.now();
    if (this.isOpen && tables !== this.tables) this.errors.ask({ tables });
  }

  /** Return the design to be rendered: with errors, if errors of this design are set. */
  renderedDesign(design: Design): Design {
    const tables = this.isOpen && design.tables === this.tables ? this.last?.tables : null;
    return tables ? { ...design, tables } : design;
  }

  /** Set the errors of an address; "" closes the panel. Returns whether the text is valid. */
  goTo(text: string): boolean {
    if (text === this.text) return true;
    const settings = text ? errorSettingsOf(text) : null;
    if (text && !settings) return false;
    this.requested = settings;
    if (!settings === this.isOpen) this.toggle();
    else if (this.all) this.known(this.all, { tables: this.tables! });
    return true;
  }

  /** Tolerances with the limit of the yield; null if the panel is closed or has no limit. */
  get plan(): TolerancePlanMessage | null {
    const limit = Number(this.limit.value);
    if (!this.isOpen || !this.tables || !(limit > 0)) return null;
    const errors = [...this.tolerances]
      .filter(([, tolerance]) => tolerance > 0)
      .map(([name, tolerance]) => ({ name, tolerance }));
    const quantity = this.quantity.input.value;
    const merit = meritName(quantity, quantity === "blur_px" ? "none" : this.after.input.value);
    return { errors, refocus: this.refocus, merit, limit };
  }

  /** Errors as text for the address. */
  private get text(): string {
    if (!this.isOpen || !this.all) return "";
    const usual = gradeTolerances(this.all.errors, this.gradeChosen);
    const [values, tolerances] = [
      [...this.values].filter(([, value]) => value !== 0),
      [...this.tolerances].filter(([name, tolerance]) => tolerance !== usual.get(name)),
    ];
    return textOf({
      grade: this.gradeChosen,
      focus: this.refocus,
      after: this.after.input.value,
      quantity: this.quantity.input.value as ErrorSettings["quantity"],
      limit: Number(this.limit.value) || 0,
      values: Object.fromEntries(values),
      tolerances: Object.fromEntries(tolerances),
    });
  }

  /** Set the requested errors that apply to the current sensor. */
  private take(settings: ErrorSettings): void {
    this.requested = null;
    const { calibrations, errors } = this.all!;
    const strange = Object.keys({ ...settings.values, ...settings.tolerances }).filter(
      (name) => !this.values.has(name),
    );
    if (strange.length)
      this.callbacks.say(
        `Ignored errors that do not apply to this sensor: ${strange.map(errorWords).join(", ")}.`,
      );
    this.grade.input.value = settings.grade;
    this.focus.input.value = settings.focus;
    this.after.input.value = calibrations.includes(settings.after)
      ? settings.after
      : calibrations[0];
    this.quantity.input.value = settings.quantity;
    this.limit.value = String(settings.limit || USUAL[settings.quantity] || "");
    this.tolerances = gradeTolerances(errors, settings.grade);
    for (const name of this.values.keys()) {
      this.values.set(name, settings.values[name] ?? 0);
      if (name in settings.tolerances) this.tolerances.set(name, settings.tolerances[name]);
    }
    this.showRows();
  }

  private toggle(): void {
    this.body.hidden = this.charts.element.hidden = this.isOpen;
    this.begin.setAttribute("aria-expanded", String(this.isOpen));
    this.begin.textContent = this.isOpen ? "Close tolerances" : "Analyse tolerances";
    if (this.isOpen) return this.follow();
    this.tables = this.last = null;
    this.callbacks.keep("");
    this.callbacks.show(this.callbacks.now());
  }

  private known(result: ErrorSourceList, { tables }: ErrorSourcesRequest): void {
    if (!this.isOpen) return;
    const isOther =
      JSON.stringify(result.errors.map((e) => e.name)) !==
      JSON.stringify(this.all?.errors.map((e) => e.name));
    const isFirst = this.all === null;
    this.tables = tables;
    this.all = result;
    if (isOther) {
      this.values = new Map(result.errors.map((e) => [e.name, this.values.get(e.name) ?? 0]));
      this.tolerances = gradeTolerances(result.errors, this.gradeChosen);
      this.after.offer(
        result.calibrations.map((name) => [name, calibrationWords(name)]),
        isFirst ? "pose" : this.after.input.value,
      );
      this.build(result.errors);
    }
    if (this.requested) this.take(this.requested);
    this.request();
  }

  private get gradeChosen(): ErrorSettings["grade"] {
    return this.grade.input.value as ErrorSettings["grade"];
  }

  private build(errors: readonly ErrorSourceInfo[]): void {
    this.rows.clear();
    const groups = new Map<string, HTMLElement>();
    for (const error of errors) {
      const row = new ErrorRow(error, this.numbersOf(error.name), {
        tried: (name, value) => this.tried(name, value),
        setTolerance: (name, tolerance) => this.setTolerance(name, tolerance),
      });
      this.rows.set(error.name, row);
      if (!groups.has(error.group)) groups.set(error.group, h("div", {}));
      groups.get(error.group)!.append(row.element);
    }
    this.groups.replaceChildren(
      ...[...groups].map(([group, rows], i) =>
        h("details", { className: "more", open: i === 0 }, h("summary", {}, capital(group)), rows),
      ),
    );
  }

  private readonly numbersOf = (name: string): { value: number; tolerance: number } => ({
    value: this.values.get(name) ?? 0,
    tolerance: this.tolerances.get(name) ?? 0,
  });

  private tried(name: string, value: number): void {
    this.values.set(name, value);
    this.askBuilt();
  }

  private setTolerance(name: string, tolerance: number): void {
    this.tolerances.set(name, tolerance);
    this.askYield();
  }

  private grades(): void {
    if (!this.all) return;
    this.tolerances = gradeTolerances(this.all.errors, this.gradeChosen);
    this.showRows();
    this.askYield();
  }

  /** Draw random errors within the tolerances. */
  private draw(): void {
    for (const [name, tolerance] of this.tolerances)
      this.values.set(name, Number(((2 * Math.random() - 1) * tolerance).toPrecision(DIGITS)));
    this.showRows();
    this.askBuilt();
  }

  private none(): void {
    for (const name of this.values.keys()) this.values.set(name, 0);
    this.showRows();
    this.askBuilt();
  }

  private showRows(): void {
    for (const [name, row] of this.rows) row.set(this.numbersOf(name));
  }

  /** Select another limited quantity with its default limit. */
  private chosen(): void {
    const quantity = this.quantity.input.value;
    const blur = this.last?.blur_px[0] ?? 10;
    this.limit.value = String(USUAL[quantity] ?? Number((MORE_BLUR * blur).toPrecision(2)));
    this.judged();
  }

  private judged(): void {
    if (this.last) this.drawMoved(this.last);
    this.askYield();
  }

  private request(): void {
    this.askBuilt();
    this.askYield();
  }

  private get refocus(): AsBuiltRequest["refocus"] {
    return this.focus.input.value as AsBuiltRequest["refocus"];
  }

  private askBuilt(): void {
    this.callbacks.keep(this.text);
    if (this.tables)
      this.built.ask({
        tables: this.tables,
        values: Object.fromEntries(this.values),
        refocus: this.refocus,
      });
  }

  private askYield(): void {
    this.callbacks.keep(this.text);
    const { plan, tables } = this;
    if (plan && tables) this.yields.ask({ tables, ...plan, trials: TRIALS, seed: SEED });
  }

  private moved(moved: AsBuiltDisplacement, { tables }: AsBuiltRequest): void {
    if (!this.isOpen || tables !== this.tables) return;
    this.problem.hidden = true;
    this.last = moved;
    this.drawMoved(moved);
    this.callbacks.show(this.renderedDesign(this.callbacks.now()));
  }

  private drawMoved(moved: AsBuiltDisplacement): void {
    const { calibrations } = this.all!;
    this.charts.showMoved(moved, calibrations, this.after.input.value);
    const depth = Math.max(calibrations.indexOf(this.after.input.value), 0);
    const pair = (of: readonly (number | null)[], unit: string): string =>
      `${sizeWords(of[0], unit)} as built${depth ? `, ${sizeWords(of[depth], unit)} calibrated` : ""}`;
    const lines: [string, string][] = [
      ["Motion", pair(moved.motion_px, " px")],
      ["Direction", pair(moved.direction_error_deg, "°")],
      [
        "Blur",
        `${words(moved.blur_px[1], 3)} px (${words(moved.blur_px[0], 3)} px without errors)`,
      ],
    ];
    if (moved.straightness_deg.some((v) => v !== null))
      lines.splice(2, 0, ["Straightness", pair(moved.straightness_deg, "°")]);
    this.summary.replaceChildren(
      ...lines.map(([name, text]) =>
        h("li", {}, h("b", {}, name), h("span", {}, moved.lost ? "objects are not imaged" : text)),
      ),
    );
  }

  private good(result: YieldResult): void {
    if (!this.isOpen) return;
    this.problem.hidden = true;
    const percent = (share: number): string => fixed(100 * share, 1);
    this.verdict.textContent = `${percent(result.fraction)} % yield (95 % interval ${percent(result.low)} to ${percent(result.high)} %), ${result.trials} simulated sensors`;
    this.verdict.classList.toggle("missed", result.fraction < 0.5);
    this.charts.showYield(result, this.all!.calibrations);
  }

  private fail(message: string): void {
    this.problem.textContent = capital(message);
    this.problem.hidden = false;
  }
}

/** Create a selection with its title; `offer` replaces the options. */
function select(
  title: string,
  all: readonly (readonly [string, string])[],
  chosen: () => void,
): {
  element: HTMLElement;
  input: HTMLSelectElement;
  offer: (all: readonly (readonly [string, string])[], value: string) => void;
} {
  const input = h("select");
  const offer = (options: readonly (readonly [string, string])[], value: string): void => {
    input.replaceChildren(...options.map(([name, text]) => h("option", { value: name }, text)));
    input.value = value;
  };
  offer(all, all[0][0]);
  input.addEventListener("change", chosen);
  return {
    element: labelledField(title, input),
    input,
    offer,
  };
}
