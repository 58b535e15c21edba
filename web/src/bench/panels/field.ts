import { h, unique } from "../../shared/dom";
import type { ParameterOf } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { unitWords } from "../labels";
import { type Scale, scaleOf } from "./scale";

/** A slider and a number field for one number. */
export class Field {
  readonly element: HTMLElement;
  private readonly number: HTMLInputElement;
  private readonly slider: HTMLInputElement;
  private readonly problem: HTMLElement;
  private readonly ends = [h("span", {}), h("span", {})];
  private scale: Scale;

  /** `changed` is told each value, `settled` when a slider is let go or a number is entered. */
  constructor(private readonly p: ParameterOf, title: string, private value: number, private readonly changed: (value: number) => void, private readonly settled: () => void) {
    const id = unique();
    const unit = unitWords(p.unit);
    const limits = `${words(p.low)} to ${words(p.high)}${unit ? ` ${unit}` : ""}`;
    this.scale = scaleOf(p, value);
    this.number = h("input", { type: "number", id, step: p.is_whole ? "1" : "any", min: String(p.low), max: String(p.high), "aria-describedby": `${id}h ${id}p` });
    this.slider = h("input", { type: "range", min: "0", max: "1", step: "0.001", "aria-label": `${title}, slider` });
    this.problem = h("p", { id: `${id}p`, className: "problem", hidden: true });
    this.element = h(
      "div",
      { className: "field", title: `${p.description ? `${p.description}; ` : ""}${limits}` },
      h("label", { htmlFor: id }, title),
      h("span", { className: "entry" }, this.number, h("span", { className: "unit" }, unit)),
      this.slider,
      h("span", { className: "ends", "aria-hidden": "true" }, ...this.ends),
      h("span", { id: `${id}h`, className: "hidden" }, `${p.description}; ${limits}`),
      this.problem,
    );
    this.slider.addEventListener("input", () => this.take(this.scale.to(Number(this.slider.value)), this.slider));
    this.slider.addEventListener("change", () => this.letGo());
    this.number.addEventListener("input", () => this.number.value !== "" && this.take(Number(this.number.value), this.number));
    this.number.addEventListener("change", () => this.enter());
    this.show(value);
  }

  /** Show a value that was set elsewhere. */
  set(value: number): void {
    if (value === this.value) return;
    this.value = value;
    if (value < this.scale.low || value > this.scale.high) this.scale = scaleOf(this.p, value);
    this.show(value);
  }

  /** Say why the value cannot be, beside it; null when it can. */
  complain(sentence: string | null): void {
    this.problem.hidden = sentence === null;
    const words = (sentence ?? "").replace(/^./, (c) => c.toUpperCase());
    if (this.problem.textContent !== words) this.problem.textContent = words;
    this.number.setAttribute("aria-invalid", String(sentence !== null));
  }

  private take(value: number, from: HTMLInputElement): void {
    this.value = value;
    this.show(value, from);
    this.changed(value);
  }

  private enter(): void {
    if (this.number.value === "") this.show(this.value);
    else if (this.value < this.scale.low || this.value > this.scale.high) this.scale = scaleOf(this.p, this.value);
    this.show(this.value);
    this.settled();
  }

  /** A slider that was let go at its end gets room beyond it. */
  private letGo(): void {
    const place = Number(this.slider.value);
    if (place < 0.02 || place > 0.98) {
      this.scale = scaleOf(this.p, this.value);
      this.show(this.value);
    }
    this.settled();
  }

  private show(value: number, from?: HTMLInputElement): void {
    if (from !== this.number) this.number.value = String(Number(value.toPrecision(6)));
    if (from !== this.slider) this.slider.value = String(this.scale.from(value));
    [this.scale.low, this.scale.high].forEach((end, i) => (this.ends[i].textContent = words(end, 3)));
    this.slider.setAttribute("aria-valuetext", `${words(value)} ${unitWords(this.p.unit)}`.trim());
  }
}
