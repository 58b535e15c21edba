import { h, reveal, unique, write } from "../../shared/dom";
import type { ParameterInfo } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { labelledMessage, unitWords } from "../labels";
import { feasibleSpans, type Violations, placesWith, type Span } from "./feasible_ranges";
import { type Scale, scaleOf } from "./slider_scale";

/** Slider and number field of one number. */
export class Field {
  readonly element: HTMLElement;
  private readonly number: HTMLInputElement;
  private readonly slider: HTMLInputElement;
  private readonly problem: HTMLElement;
  private readonly ends = [h("span", {}), h("span", {})];
  private readonly back = h("button", { type: "button", className: "back", hidden: true }, "↺");
  private readonly marks = h("span", { className: "marks", "aria-hidden": "true" });
  private readonly meets = h("span", { className: "hidden" });
  private complaint: string | null = null;
  private marked = "";
  private met: { scale: Scale; spans: readonly Span[] } | null = null;
  /** Initial value, restored by the reset button. */
  private first: number;
  private scale: Scale;
  /** Whether the last action on the slider or the field was an arrow key. */
  private isByKey = false;

  /** `changed` receives each value; `settled` commits the value of a slider or field, with true after a key press. */
  constructor(
    private readonly p: ParameterInfo,
    title: string,
    private value: number,
    private readonly changed: (value: number) => void,
    private readonly settled: (isByKey: boolean) => void,
  ) {
    const id = unique();
    const unit = unitWords(p.unit);
    const limits = `${words(p.low)} to ${words(p.high)}${unit ? ` ${unit}` : ""}`;
    this.scale = scaleOf(p, value);
    this.number = h("input", {
      type: "number",
      id,
      step: p.is_integer ? "1" : "any",
      min: String(p.low),
      max: String(p.high),
      "aria-describedby": `${id}h ${id}m ${id}p`,
    });
    this.slider = h("input", {
      type: "range",
      min: "0",
      max: "1",
      step: "0.001",
      "aria-label": `${title}, slider`,
    });
    this.first = value;
    this.meets.id = `${id}m`;
    this.back.addEventListener("click", () => this.goBack());
    this.problem = h("p", { id: `${id}p`, className: "problem", hidden: true });
    this.element = h(
      "div",
      { className: "field", title: `${p.description ? `${p.description}; ` : ""}${limits}` },
      h("span", { className: "what" }, h("label", { htmlFor: id }, title), this.back),
      h("span", { className: "entry" }, this.number, h("span", { className: "unit" }, unit)),
      h("span", { className: "slide" }, this.marks, this.slider),
      h("span", { className: "ends", "aria-hidden": "true" }, ...this.ends),
      h("span", { id: `${id}h`, className: "hidden" }, `${p.description}; ${limits}`),
      this.meets,
      this.problem,
    );
    for (const input of [this.slider, this.number]) {
      input.addEventListener("keydown", (e) => (this.isByKey = e.key.startsWith("Arrow")));
      input.addEventListener("pointerdown", () => (this.isByKey = false));
      input.addEventListener("blur", () => this.isByKey && this.settled(false));
    }
    this.slider.addEventListener("input", () =>
      this.take(this.scale.to(Number(this.slider.value)), this.slider),
    );
    this.slider.addEventListener("change", () => this.release());
    this.number.addEventListener(
      "input",
      () => this.number.value !== "" && this.take(Number(this.number.value), this.number),
    );
    this.number.addEventListener("change", () => this.enter());
    this.show(value);
  }

  /** Display a value that was set elsewhere. */
  set(value: number): void {
    if (value === this.value) return;
    this.value = value;
    if (value < this.scale.low || value > this.scale.high) this.scale = scaleOf(this.p, value);
    this.show(value);
  }

  /** Set the initial value. */
  begin(value: number): void {
    this.first = value;
    this.show(this.value);
  }

  /** Sample values along the slider, and its position. */
  get along(): number[] {
    return this.places.map((place) => this.scale.to(place));
  }

  private get places(): number[] {
    return placesWith(this.scale.from(this.value));
  }

  /** Mark the feasible range of the slider, from the violation of requirements along it; null if unknown. */
  showFeasible(violations: readonly Violations[] | null): void {
    if (!violations && !this.met) return;
    const spans = violations && feasibleSpans(this.places, violations);
    this.met = spans && { scale: this.scale, spans };
    const unit = unitWords(this.p.unit);
    const parts = spans?.map((span) =>
      span.map((place) => words(this.scale.to(place))).join(" to "),
    );
    this.meets.textContent = parts
      ? parts.length
        ? `All requirements are met at ${parts.join(" and ")}${unit && ` ${unit}`}.`
        : "No sampled value of the slider meets all requirements."
      : "";
    this.slider.title = this.meets.textContent;
    this.mark();
  }

  private goBack(): void {
    this.value = this.first;
    if (this.value < this.scale.low || this.value > this.scale.high)
      this.scale = scaleOf(this.p, this.value);
    this.show(this.value);
    this.changed(this.value);
    this.settled(false);
    this.slider.focus();
  }

  /** Display the error of a value; null removes it. */
  showError(message: string | null): void {
    if (message === this.complaint) return;
    this.complaint = message;
    reveal(this.problem, message !== null);
    write(this.problem, labelledMessage(message ?? ""));
    this.number.setAttribute("aria-invalid", String(message !== null));
  }

  private take(value: number, from: HTMLInputElement): void {
    this.value = value;
    this.show(value, from);
    this.changed(value);
  }

  private enter(): void {
    if (this.number.value === "") this.show(this.value);
    else if (this.value < this.scale.low || this.value > this.scale.high)
      this.scale = scaleOf(this.p, this.value);
    this.show(this.value);
    this.settled(this.isByKey);
  }

  /** Extend the range of a slider that was released at its end. */
  private release(): void {
    const place = Number(this.slider.value);
    if (place < 0.02 || place > 0.98) {
      this.scale = scaleOf(this.p, this.value);
      this.show(this.value);
    }
    this.settled(this.isByKey);
  }

  private show(value: number, from?: HTMLInputElement): void {
    if (from !== this.number) this.number.value = String(Number(value.toPrecision(6)));
    if (from !== this.slider) this.slider.value = String(this.scale.from(value));
    [this.scale.low, this.scale.high].forEach((end, i) => write(this.ends[i], words(end, 3)));
    this.mark();
    this.slider.setAttribute("aria-valuetext", `${words(value)} ${unitWords(this.p.unit)}`.trim());
  }

  /** Mark initial value, default and valid range on the slider, as far as they are within its range. */
  private mark(): void {
    const { low, high } = this.scale;
    const all: [string, number][] = [
      ["stop", this.p.low],
      ["stop", this.p.high],
      ["first", this.first],
    ];
    if (this.p.default !== null) all.push(["usual", this.p.default]);
    const shown = all.filter(
      ([, v]) => v >= low - 1e-9 * Math.abs(low) && v <= high + 1e-9 * Math.abs(high),
    );
    const spans = shown.map(([kind, v]) => [
      kind,
      `left: ${(100 * this.scale.from(v)).toFixed(2)}%`,
    ]);
    const met = (this.met?.spans ?? []).map((span) =>
      span.map((place) => 100 * this.scale.from(this.met!.scale.to(place))),
    );
    const bars = met.map(([from, to]) => [
      "met",
      `left: ${from.toFixed(2)}%; width: ${(to - from).toFixed(2)}%`,
    ]);
    const marked = [...bars, ...spans];
    if (marked.join() !== this.marked)
      this.marks.replaceChildren(
        ...marked.map(([className, style]) => h("span", { className, style })),
      );
    this.marked = marked.join();
    const isMoved = Math.abs(this.value - this.first) > 1e-6 * Math.max(Math.abs(this.first), 1e-3);
    reveal(this.back, isMoved);
    this.back.title = `Reset to ${words(this.first)}`;
    this.back.setAttribute("aria-label", this.back.title);
  }
}
